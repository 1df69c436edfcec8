//! Flags -> `--set` overrides, and back: a complaint about an override that a flag made names the
//! flag.

use clap::ValueEnum;
use serde_json::Value;

use crate::{
    error::{Error, Problem},
    scene::{Description, written::Light},
};

use super::args::SceneArgs;

/// Overrides in the order in which they are applied, and the flags they come from.
#[derive(Debug, Default)]
pub struct Overrides {
    /// Flag, JSON pointer, `POINTER=VALUE`. `--set` itself has no flag.
    list: Vec<(Option<&'static str>, String, String)>,
}

impl Overrides {
    /// The flags that need no look at the scene, then every `--set`.
    pub fn new(args: &SceneArgs) -> Self {
        let mut all = Self::default();
        let name = |value: Option<clap::builder::PossibleValue>| {
            value.map(|value| Value::from(value.get_name()))
        };
        let [width, height] = match args.size {
            Some([w, h]) => [Some(w), Some(h)],
            None => [None; 2],
        };
        all.flag("--size", "/camera/width", width);
        all.flag("--size", "/camera/height", height);
        all.flag("--spp", "/spp", args.spp);
        all.flag("--nbounces", "/nbounces", args.nbounces);
        all.flag("--seed", "/seed", args.seed);
        let sampler = args.sampler.and_then(|s| name(s.to_possible_value()));
        all.flag("--sampler", "/sampler", sampler);
        all.flag("--fov", "/camera/fov", args.fov.map(number));
        all.flag("--exposure", "/tonemap/exposure", args.exposure.map(number));
        let tonemap = args.tonemap.and_then(|t| name(t.to_possible_value()));
        all.flag("--tonemap", "/tonemap/operator", tonemap);
        let backend = args.backend.and_then(|b| name(b.to_possible_value()));
        all.flag("--backend", "/scene/accelerator", backend);
        let transparent = args.transparent.then_some(true);
        all.flag("--transparent", "/output/transparent", transparent);
        let shadows = args.adaptive_shadows.then_some(true);
        all.flag("--adaptive-shadows", "/adaptiveshadows", shadows);
        all.flag("--aov", "/output/layers", args.aov.clone());
        for set in &args.set {
            let pointer = set.split_once('=').map_or(set.as_str(), |(pointer, _)| pointer);
            all.list.push((None, pointer.to_string(), set.clone()));
        }
        all
    }

    /// Adds an override by a flag, or nothing.
    pub fn flag<T: Into<Value>>(&mut self, flag: &'static str, pointer: &str, value: Option<T>) {
        if let Some(value) = value {
            let set = format!("{pointer}={}", value.into());
            self.list.push((Some(flag), pointer.to_string(), set));
        }
    }

    /// Puts `--light-samples` before every `--set`: one override per area light. Says whether
    /// there is any.
    pub fn light_samples(&mut self, samples: u32, scene: &Description) -> bool {
        let lights = scene.scene.lightsources.iter().enumerate();
        let mut made = Self::default();
        for (i, light) in lights {
            if matches!(light, Light::AreaLight(_)) {
                let pointer = format!("/scene/lightsources/{i}/samples");
                made.flag("--light-samples", &pointer, Some(samples));
            }
        }
        let any = !made.list.is_empty();
        self.prepend(made);
        any
    }

    /// Puts `first` before all others, so that these win.
    pub fn prepend(&mut self, mut first: Self) {
        first.list.append(&mut self.list);
        self.list = first.list;
    }

    /// As the scene parser takes them.
    pub fn sets(&self) -> Vec<String> {
        self.list.iter().map(|(_, _, set)| set.clone()).collect()
    }

    /// Names the flag instead of the `--set` it became.
    pub fn explain(&self, error: Error) -> Error {
        let problems = error.problems.into_iter().map(|problem| self.named(problem));
        Error { kind: error.kind, problems: problems.collect() }
    }

    fn named(&self, problem: Problem) -> Problem {
        let Some(rest) = problem.place.strip_prefix("--set ") else {
            return problem;
        };
        // The last one wins, so it is the one that is wrong.
        let culprit = self.list.iter().rev().find(|(_, pointer, set)| {
            rest == pointer || rest == set || rest.starts_with(&format!("{pointer} "))
        });
        match culprit {
            Some((Some(flag), ..)) => Problem { place: (*flag).to_string(), ..problem },
            _ => problem,
        }
    }
}

/// A number that JSON may not have (NaN) stays visible in the message.
fn number(value: f64) -> Value {
    match serde_json::Number::from_f64(value) {
        Some(number) => Value::Number(number),
        None => Value::from(value.to_string()),
    }
}
