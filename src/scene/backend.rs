//! What finds the hits: one value, from the scene's `accelerator` and the flags beside it to
//! [`crate::accel::build`]. What contradicts itself is refused here, and cannot be written down after.

use super::description::Accelerator;
use crate::error::{Error, Kind, Problem, Result};
use crate::simd::Isa;

/// What finds the hits, and how.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Backend {
    /// Intel Embree 4, which chooses its instruction set itself.
    Embree(EmbreeMode),
    /// Our own tree, by the kernels of an instruction set.
    Bvh(Isa),
    /// The coursework's BVH.
    Coursework,
    /// Every primitive: the oracle.
    Brute,
}

/// Which of its triangle tests Embree runs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum EmbreeMode {
    /// With its ROBUST flag: rays aimed at vertices of a closed mesh may leak.
    #[default]
    Robust,
    /// Without that flag: a little faster, rays leak at edges, too.
    Fast,
    /// `Robust` with the COMPACT flag: half the memory and slower queries. Only measuring commands
    /// name it.
    Compact,
}

impl Backend {
    /// As the scene format spells it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Embree(_) => "embree",
            Self::Bvh(_) => "bvh",
            Self::Coursework => "coursework",
            Self::Brute => "brute",
        }
    }

    /// The instruction set of our kernels beside it: those that shade. The best of this machine, unless the
    /// tree's own was chosen.
    pub fn isa(self) -> Isa {
        match self {
            Self::Bvh(isa) => isa,
            Self::Embree(_) | Self::Coursework | Self::Brute => Isa::detect(),
        }
    }
}

/// As it works where no flag says how: Embree robust, our tree by the best instruction set.
impl From<Accelerator> for Backend {
    fn from(accelerator: Accelerator) -> Self {
        match accelerator {
            Accelerator::Bvh => Self::Bvh(Isa::detect()),
            Accelerator::Embree => Self::Embree(EmbreeMode::Robust),
            Accelerator::Coursework => Self::Coursework,
            Accelerator::Brute => Self::Brute,
        }
    }
}

/// What is used where nothing else is named.
impl Default for Backend {
    fn default() -> Self {
        Accelerator::default().into()
    }
}

/// Flags that say how a backend works. Each belongs to one of them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct BackendFlags {
    /// `--fast`: Embree without its robust mode.
    pub fast: bool,
    /// `--isa`: instruction set of `bvh` and of the shading, one that this machine runs.
    pub isa: Option<Isa>,
}

impl BackendFlags {
    /// The backend that a scene names, working as the flags say.
    ///
    /// # Errors
    /// `Invalid` with every flag that belongs to another backend.
    pub fn on(self, accelerator: Accelerator) -> Result<Backend> {
        let plain = Backend::from(accelerator);
        let (backend, fast, isa) = match (plain, self) {
            (Backend::Embree(_), Self { fast: true, isa }) => {
                (Backend::Embree(EmbreeMode::Fast), false, isa)
            }
            (Backend::Bvh(_), Self { fast, isa: Some(isa) }) => (Backend::Bvh(isa), fast, None),
            (plain, Self { fast, isa }) => (plain, fast, isa),
        };
        let name = backend.name();
        let fast = fast.then(|| {
            let message = format!("found with the backend `{name}`, which has no fast mode");
            Problem::new("--fast", message).help("leave --fast out, or --backend embree")
        });
        let isa = isa.map(|_| {
            let why = match backend {
                Backend::Embree(_) => "which chooses its instruction set itself",
                _ => "which has no kernels of its own",
            };
            let message = format!("found with the backend `{name}`, {why}");
            Problem::new("--isa", message).help("leave --isa out, or --backend bvh")
        });
        let problems: Vec<Problem> = fast.into_iter().chain(isa).collect();
        match problems.is_empty() {
            true => Ok(backend),
            false => Err(Error { kind: Kind::Invalid, problems }),
        }
    }

    /// These, and where `last` says something, that.
    pub fn then(self, last: Self) -> Self {
        Self { fast: self.fast || last.fast, isa: last.isa.or(self.isa) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flag_belongs_to_one_backend() {
        let isa = Some(Isa::Portable);
        let all =
            [Accelerator::Bvh, Accelerator::Embree, Accelerator::Coursework, Accelerator::Brute];
        for (fast, isa) in [(false, None), (true, None), (false, isa), (true, isa)] {
            for accelerator in all {
                let made = BackendFlags { fast, isa }.on(accelerator);
                let wrong = [
                    ("--fast", fast && accelerator != Accelerator::Embree),
                    ("--isa", isa.is_some() && accelerator != Accelerator::Bvh),
                ];
                let wrong: Vec<&str> = wrong.iter().filter(|w| w.1).map(|w| w.0).collect();
                let said: Vec<String> = match made {
                    Ok(backend) => {
                        assert_eq!(backend.name(), Backend::from(accelerator).name());
                        assert_eq!(backend == Backend::Embree(EmbreeMode::Fast), fast);
                        assert_eq!(isa, isa.map(|_| backend.isa()));
                        Vec::new()
                    }
                    Err(error) => {
                        assert_eq!(error.kind, Kind::Invalid);
                        error.problems.into_iter().map(|problem| problem.place).collect()
                    }
                };
                assert_eq!(said, wrong, "{accelerator:?}");
            }
        }
    }
}
