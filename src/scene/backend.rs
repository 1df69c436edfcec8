//! The backend that finds the hits. One value carries the scene's `accelerator` and its flags to
//! [`crate::accel::build`]. Contradictory flags are refused here, and the type cannot express them.

use super::description::AcceleratorName;
use crate::error::{Error, ErrorKind, Problem, Result};
use crate::simd::Isa;

/// The backend that finds the hits, with its mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Backend {
    /// Intel Embree 4, which chooses its instruction set itself.
    Embree(EmbreeMode),
    /// Our own tree, with the kernels of an instruction set.
    Bvh(Isa),
    /// The BVH of the coursework.
    Coursework,
    /// A test of every primitive: the oracle.
    Brute,
}

/// The mode of Embree: its triangle test and its memory layout.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum EmbreeMode {
    /// With Embree's ROBUST flag. Rays aimed at vertices of a closed mesh may leak.
    #[default]
    Robust,
    /// Without that flag: a little faster, but rays leak at edges too.
    Fast,
    /// `Robust` with the COMPACT flag: half the memory and slower queries. Only measuring commands
    /// use it.
    Compact,
}

impl Backend {
    /// Returns the name that the scene format uses.
    pub fn name(self) -> &'static str {
        match self {
            Self::Embree(_) => "embree",
            Self::Bvh(_) => "bvh",
            Self::Coursework => "coursework",
            Self::Brute => "brute",
        }
    }

    /// Whether the backend traces instances. Others need a copy of the mesh for each.
    pub fn traces_instances(self) -> bool {
        matches!(self, Self::Bvh(_) | Self::Brute)
    }

    /// Returns the instruction set of our shading kernels: the one chosen for the tree, or else the
    /// best of this machine.
    pub fn isa(self) -> Isa {
        match self {
            Self::Bvh(isa) => isa,
            Self::Embree(_) | Self::Coursework | Self::Brute => Isa::detect(),
        }
    }
}

/// The default mode of each backend: Embree robust, our tree with the best instruction set.
impl From<AcceleratorName> for Backend {
    fn from(accelerator: AcceleratorName) -> Self {
        match accelerator {
            AcceleratorName::Bvh => Self::Bvh(Isa::detect()),
            AcceleratorName::Embree => Self::Embree(EmbreeMode::Robust),
            AcceleratorName::Coursework => Self::Coursework,
            AcceleratorName::Brute => Self::Brute,
        }
    }
}

/// The backend for a scene that names none.
impl Default for Backend {
    fn default() -> Self {
        AcceleratorName::default().into()
    }
}

/// Flags that select the mode of a backend. Each flag belongs to one backend.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct BackendFlags {
    /// `--fast`: Embree without its robust mode.
    pub fast: bool,
    /// `--isa`: instruction set of `bvh` and of shading. The caller has checked that this machine
    /// supports it.
    pub isa: Option<Isa>,
}

impl BackendFlags {
    /// Returns the backend that a scene names, in the mode that the flags select.
    ///
    /// # Errors
    /// `Invalid`, with every flag that belongs to another backend.
    pub fn on(self, accelerator: AcceleratorName) -> Result<Backend> {
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
        Error::check(ErrorKind::Invalid, fast.into_iter().chain(isa).collect())?;
        Ok(backend)
    }

    /// Returns both sets of flags together. `last` takes precedence.
    pub fn then(self, last: Self) -> Self {
        Self { fast: self.fast || last.fast, isa: last.isa.or(self.isa) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flag_of_another_backend_is_an_error() {
        let isa = Some(Isa::Portable);
        let all = [
            AcceleratorName::Bvh,
            AcceleratorName::Embree,
            AcceleratorName::Coursework,
            AcceleratorName::Brute,
        ];
        for (fast, isa) in [(false, None), (true, None), (false, isa), (true, isa)] {
            for accelerator in all {
                let result = BackendFlags { fast, isa }.on(accelerator);
                let wrong = [
                    ("--fast", fast && accelerator != AcceleratorName::Embree),
                    ("--isa", isa.is_some() && accelerator != AcceleratorName::Bvh),
                ];
                let wrong: Vec<&str> = wrong.iter().filter(|w| w.1).map(|w| w.0).collect();
                let places: Vec<String> = match result {
                    Ok(backend) => {
                        assert_eq!(backend.name(), Backend::from(accelerator).name());
                        assert_eq!(backend == Backend::Embree(EmbreeMode::Fast), fast);
                        assert_eq!(isa, isa.map(|_| backend.isa()));
                        Vec::new()
                    }
                    Err(error) => {
                        assert_eq!(error.kind, ErrorKind::Invalid);
                        error.problems.into_iter().map(|problem| problem.place).collect()
                    }
                };
                assert_eq!(places, wrong, "{accelerator:?}");
            }
        }
    }
}
