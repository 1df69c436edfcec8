//! Converts flags to `--set` overrides. A problem with such an override names the flag.

use serde_json::Value;

use crate::error::{Error, Problem, Result};

use super::backend::BackendFlags;
use super::description::{LightDescription, SceneDescription};
use super::load_scene::{self, Loaded, Source};
use super::node::JsonPlace;

/// Overrides in the order of their application, with the flags they come from.
#[derive(Debug, Clone, Default)]
pub struct Overrides {
    /// Flag, JSON pointer, `POINTER=VALUE`. `--set` itself has no flag.
    list: Vec<(Option<&'static str>, String, String)>,
    /// Options of the backend that the scene selects.
    backend: BackendFlags,
}

impl Overrides {
    /// Adds a `--set` given by the user.
    pub fn set(&mut self, set: &str) {
        let pointer = set.split_once('=').map_or(set, |(pointer, _)| pointer);
        self.list.push((None, pointer.to_string(), set.to_string()));
    }

    /// Adds the override of a flag, if the flag has a value.
    pub fn flag<T: Into<Value>>(&mut self, flag: &'static str, pointer: &str, value: Option<T>) {
        if let Some(value) = value {
            let set = format!("{pointer}={}", value.into());
            self.list.push((Some(flag), pointer.to_string(), set));
        }
    }

    /// Returns true if an override sets a value at `pointer` or below it.
    pub fn touches(&self, pointer: &str) -> bool {
        let below = |at: &String| {
            at.strip_prefix(pointer).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
        };
        self.list.iter().any(|(_, at, _)| below(at))
    }

    /// Adds options of the backend. They take precedence over earlier ones.
    pub fn backend(&mut self, flags: BackendFlags) {
        self.backend = self.backend.then(flags);
    }

    /// Adds `--light-samples`: an override for each area light, sun and environment of `scene`,
    /// which is `source` with all overrides so far. A light whose `samples` a `--set` names keeps
    /// them. A sun of size 0 has no samples. Returns false if no light has samples.
    ///
    /// # Errors
    /// As for [`load_scene::document`].
    pub fn light_samples(
        &mut self,
        samples: u32,
        source: Source,
        scene: &SceneDescription,
    ) -> Result<bool> {
        let (mut document, _) = load_scene::document(source)?;
        for (_, _, set) in &self.list {
            // An override with an error was refused when `scene` was loaded.
            let _ = document.apply_set(set);
        }
        let mut any = false;
        for (i, light) in scene.scene.lightsources.iter().enumerate() {
            let sampled = match light {
                LightDescription::AreaLight(_) | LightDescription::Environment(_) => true,
                LightDescription::Sun(sun) => sun.angle > 0.0,
                LightDescription::PointLight(_) | LightDescription::Directional(_) => false,
            };
            any |= sampled;
            let pointer = format!("/scene/lightsources/{i}/samples");
            let place = document.get(&pointer).map(|node| &node.place);
            if sampled && !matches!(place, Some(JsonPlace::Set(_))) {
                self.flag("--light-samples", &pointer, Some(samples));
            }
        }
        Ok(any)
    }

    /// Adds the overrides of `last` after all others. They take precedence.
    pub fn append(&mut self, mut last: Self) {
        self.list.append(&mut last.list);
        self.backend(last.backend);
    }

    /// Adds the overrides of `first` before all others. The others take precedence.
    pub fn prepend(&mut self, first: Self) {
        let last = std::mem::replace(self, first);
        self.append(last);
    }

    /// Loads a scene with all overrides applied. Errors and warnings name the flag in place of its
    /// `--set`.
    ///
    /// # Errors
    /// The errors of [`load`](super::load) and of [`BackendFlags::on`].
    pub fn load(&self, source: Source) -> Result<Loaded> {
        let sets: Vec<String> = self.list.iter().map(|(_, _, set)| set.clone()).collect();
        match load_scene::load(source, &sets) {
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
        // One flag can set two values, so `--size 0x0` gives the same problem twice.
        named.dedup();
        named
    }

    fn named(&self, problem: Problem) -> Problem {
        let Some(rest) = problem.place.strip_prefix("--set ") else {
            return problem;
        };
        // The last override takes effect, so it is the one that is wrong.
        let culprit = self.list.iter().rev().find(|(_, pointer, set)| {
            rest == pointer || rest == set || rest.starts_with(&format!("{pointer} "))
        });
        match culprit {
            Some((Some(flag), ..)) => Problem { place: (*flag).to_string(), ..problem },
            _ => problem,
        }
    }
}
