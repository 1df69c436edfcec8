//! Converts flags that set values of the scene into overrides of the scene.

use serde_json::{Value, json};

use crate::error::Result;
use crate::scene::{BackendFlags, Overrides};

use super::flags::{MachineArgs, SceneArgs};

/// Returns the overrides of the scene and machine flags. `--light-samples`, `--crop` and
/// `--overscan` are not among them: they set no single value of the scene.
///
/// # Errors
/// An instruction set that this machine or this build lacks.
pub fn from_flags(args: &SceneArgs, machine: &MachineArgs) -> Result<Overrides> {
    let mut all = scene_overrides(args);
    let isa = machine.isa.map(|isa| isa.supported("--isa")).transpose()?;
    all.backend(BackendFlags { fast: machine.fast, isa });
    Ok(all)
}

/// Returns the overrides of the scene flags, followed by those of `--set`, which win.
fn scene_overrides(args: &SceneArgs) -> Overrides {
    let mut all = Overrides::default();
    add_size(&mut all, args.picture.size);
    all.flag("--spp", "/spp", args.spp);
    all.flag("--nbounces", "/nbounces", args.nbounces);
    all.flag("--seed", "/seed", args.seed);
    all.flag("--sampler", "/sampler", args.sampler.map(|sampler| json!(sampler)));
    all.flag("--fov", "/camera/fov", args.fov.map(number));
    all.flag("--exposure", "/tonemap/exposure", args.exposure.map(number));
    all.flag("--tonemap", "/tonemap/operator", args.tonemap.map(|operator| json!(operator)));
    all.flag("--backend", "/scene/accelerator", args.backend.map(|backend| json!(backend)));
    all.flag("--transparent", "/output/transparent", args.transparent.then_some(true));
    all.flag("--legend", "/output/legend", args.legend.then_some(true));
    all.flag("--adaptive-shadows", "/adaptiveshadows", args.adaptive_shadows.then_some(true));
    all.flag("--emitter-samples", "/emittersamples", args.emitter_samples);
    all.flag("--aov", "/output/layers", args.aov.clone());
    all.flag("--crypto-ranks", "/output/cryptoranks", args.crypto_ranks);
    add_sets(&mut all, &args.set);
    all
}

/// Adds the overrides of `--size`.
pub fn add_size(all: &mut Overrides, size: Option<[u32; 2]>) {
    all.flag("--size", "/camera/width", size.map(|[width, _]| width));
    all.flag("--size", "/camera/height", size.map(|[_, height]| height));
}

/// Adds the overrides of `--set`.
pub fn add_sets(all: &mut Overrides, sets: &[String]) {
    sets.iter().for_each(|set| all.set(set));
}

/// Converts a number to JSON. A number that JSON cannot hold (NaN) becomes a string, so that the
/// message can show it.
fn number(value: f64) -> Value {
    match serde_json::Number::from_f64(value) {
        Some(number) => Value::Number(number),
        None => Value::from(value.to_string()),
    }
}
