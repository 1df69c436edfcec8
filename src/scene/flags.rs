//! Flags -> `--set` overrides, and back: a complaint about an override that a flag made names the
//! flag.

use serde_json::Value;

use crate::error::{Error, Problem, Result};

use super::{
    BackendFlags, Loaded, Source,
    description::{Description, Light},
};

/// Overrides in the order in which they are applied, and the flags they come from.
#[derive(Debug, Clone, Default)]
pub struct Overrides {
    /// Flag, JSON pointer, `POINTER=VALUE`. `--set` itself has no flag.
    list: Vec<(Option<&'static str>, String, String)>,
    /// How the backend works that the scene then names.
    backend: BackendFlags,
}

impl Overrides {
    /// Adds a `--set` of the user.
    pub fn set(&mut self, set: &str) {
        let pointer = set.split_once('=').map_or(set, |(pointer, _)| pointer);
        self.list.push((None, pointer.to_string(), set.to_string()));
    }

    /// Adds an override by a flag, or nothing.
    pub fn flag<T: Into<Value>>(&mut self, flag: &'static str, pointer: &str, value: Option<T>) {
        if let Some(value) = value {
            let set = format!("{pointer}={}", value.into());
            self.list.push((Some(flag), pointer.to_string(), set));
        }
    }

    /// Adds flags that say how the backend works.
    pub fn backend(&mut self, flags: BackendFlags) {
        self.backend = self.backend.then(flags);
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

    /// Adds all of `last`, which win.
    pub fn append(&mut self, mut last: Self) {
        self.list.append(&mut last.list);
        self.backend(last.backend);
    }

    /// Puts `first` before all others, so that these win.
    pub fn prepend(&mut self, first: Self) {
        let last = std::mem::replace(self, first);
        self.append(last);
    }

    /// Loads a scene with all of them; errors and warnings name the flag instead of the `--set` it became.
    ///
    /// # Errors
    /// Those of [`load`](super::load), and of [`BackendFlags::on`].
    pub fn load(&self, source: Source) -> Result<Loaded> {
        let sets: Vec<String> = self.list.iter().map(|(_, _, set)| set.clone()).collect();
        match super::load(source, &sets) {
            Ok(mut loaded) => {
                loaded.scene.backend = self.backend.on(loaded.description.scene.accelerator)?;
                Ok(Loaded { warnings: self.all_named(loaded.warnings), ..loaded })
            }
            Err(Error { kind, problems }) => {
                Err(Error { kind, problems: self.all_named(problems) })
            }
        }
    }

    fn all_named(&self, problems: Vec<Problem>) -> Vec<Problem> {
        let mut named: Vec<Problem> = problems.into_iter().map(|p| self.named(p)).collect();
        // One flag may be two overrides, as `--size 0x0` is.
        named.dedup();
        named
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
