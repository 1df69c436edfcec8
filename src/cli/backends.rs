//! Backends that the measuring commands take by name: `bvh`, `bvh:avx2`, `embree-fast`...

use clap::ValueEnum;

use crate::{
    error::{Error, Result},
    measure::bench::Contestant,
    scene::{Backend, EmbreeMode},
    simd::Isa,
};

use super::machine;

/// Parses a backend name such as `bvh:avx2`. `flag` is for messages.
pub fn contestant(flag: &str, name: &str, isa: Isa) -> Result<Contestant> {
    let (kind, forced) = match name.split_once(':') {
        Some((kind, forced)) => (kind, Some(forced)),
        None => (name, None),
    };
    let backend = match kind {
        "bvh" => Backend::Bvh(isa),
        "embree" => Backend::Embree(EmbreeMode::Robust),
        "embree-fast" => Backend::Embree(EmbreeMode::Fast),
        "embree-compact" => Backend::Embree(EmbreeMode::Compact),
        "coursework" => Backend::Coursework,
        "brute" => Backend::Brute,
        _ => {
            let message = format!(
                "found {name:?}, expected some of bvh, embree, embree-fast, embree-compact, \
                 coursework, brute"
            );
            return Err(Error::invalid(flag, message));
        }
    };
    let backend = match (backend, forced) {
        (backend, None) => backend,
        (Backend::Bvh(_), Some(forced)) => {
            let wanted = Isa::from_str(forced, false).map_err(|_| {
                let message = format!("found {forced:?}, expected portable, avx2 or avx512");
                Error::invalid(flag, message)
            })?;
            Backend::Bvh(machine::check_isa(flag, wanted)?)
        }
        (_, Some(_)) => {
            let message = format!("found {name:?}, expected an instruction set only after bvh");
            return Err(Error::invalid(flag, message));
        }
    };
    Ok(Contestant { name: name.to_string(), backend })
}

/// Collects the backends that a flag names. `flag` is for messages.
///
/// # Errors
/// The first error of `named`; a backend that is named twice.
pub fn each_once(
    flag: &str,
    named: impl IntoIterator<Item = Result<Contestant>>,
) -> Result<Vec<Contestant>> {
    let mut contestants: Vec<Contestant> = Vec::new();
    for contestant in named {
        let contestant = contestant?;
        if contestants.contains(&contestant) {
            let message = format!("found {} twice, expected each backend once", contestant.name);
            return Err(Error::invalid(flag, message));
        }
        contestants.push(contestant);
    }
    Ok(contestants)
}
