//! Converts flags to `--set` overrides. A problem with such an override names the flag.

use std::borrow::Cow;

use serde_json::Value;

use crate::error::{Error, Problem, Result};

use super::backend::BackendFlags;
use super::description::{LightDescription, SceneDescription};
use super::document::Document;
use super::load_scene::{self, Loaded, Source};
use super::node::JsonPlace;

/// The name of a flag, or a place in a job file.
type Place = Cow<'static, str>;

/// Overrides in the order of their application, with the flags they come from.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Overrides {
    /// Flag or place in a job file, JSON pointer, `POINTER=VALUE`. `--set` itself has no flag.
    list: Vec<(Option<Place>, String, String)>,
    /// Number of overrides at the start of the list that flags win over: those of a job file.
    below: usize,
    /// Options of the backend that the scene selects.
    backend: BackendFlags,
}

impl Overrides {
    /// Adds a `--set` given by the user.
    pub fn set(&mut self, set: &str) {
        let pointer = set.split_once('=').map_or(set, |(pointer, _)| pointer);
        self.list.push((None, pointer.to_string(), set.to_string()));
    }

    /// Adds the override of a flag, if the flag has a value. `flag` may be a place in a job file.
    pub fn flag<T: Into<Value>>(
        &mut self,
        flag: impl Into<Place>,
        pointer: &str,
        value: Option<T>,
    ) {
        if let Some(value) = value {
            let set = format!("{pointer}={}", value.into());
            self.list.push((Some(flag.into()), pointer.to_string(), set));
        }
    }

    /// Returns true if an override sets a value at `pointer` or below it.
    pub fn touches(&self, pointer: &str) -> bool {
        self.list.iter().any(|(_, at, _)| is_within(at, pointer))
    }

    /// Returns the value at `pointer` that the last override of it, or of an object around it,
    /// sets: null if the object has no such key.
    pub fn value(&self, pointer: &str) -> Option<Value> {
        self.list.iter().rev().find_map(|(_, at, set)| {
            let below = pointer.strip_prefix(at.as_str()).filter(|_| is_within(pointer, at))?;
            let value: Value = serde_json::from_str(set.split_once('=')?.1).ok()?;
            Some(value.pointer(below).cloned().unwrap_or_default())
        })
    }

    /// Removes the overrides of `pointer` and of values below it.
    pub fn remove(&mut self, pointer: &str) {
        let stays = |(_, at, _): &(Option<Place>, String, String)| !is_within(at, pointer);
        self.below = self.list[..self.below].iter().filter(|set| stays(set)).count();
        self.list.retain(stays);
    }

    /// Lets flags win over all overrides so far.
    pub fn flags_follow(&mut self) {
        self.below = self.list.len();
    }

    /// Adds options of the backend. They take precedence over earlier ones.
    pub fn backend(&mut self, flags: BackendFlags) {
        self.backend = self.backend.then(flags);
    }

    /// Adds `--light-samples`: an override for each area light, sun and environment of `scene`,
    /// which is `source` with all overrides so far. A light whose `samples` a `--set` names keeps
    /// them, unless flags win over that `--set`. A sun of size 0 has no samples. Returns false if
    /// no light has samples.
    ///
    /// # Errors
    /// As for [`load_scene::document`].
    pub fn light_samples(
        &mut self,
        samples: u32,
        source: Source,
        scene: &SceneDescription,
    ) -> Result<bool> {
        let lights = &scene.scene.lightsources;
        let pointers: Vec<String> =
            (0..lights.len()).map(|i| format!("/scene/lightsources/{i}/samples")).collect();
        let (mut document, _) = load_scene::document(source)?;
        let mut set_by = |sets: &[(Option<Place>, String, String)]| -> Vec<bool> {
            for (_, _, set) in sets {
                // An override with an error was refused when `scene` was loaded.
                let _ = document.apply_set(set);
            }
            let place = |pointer: &String| document.get(pointer).map(|node| &node.place);
            let is_set = |pointer| matches!(place(pointer), Some(JsonPlace::Set(_)));
            pointers.iter().map(is_set).collect()
        };
        let (below, rest) = self.list.split_at(self.below);
        let (was_set, is_set) = (set_by(below), set_by(rest));
        let mut any = false;
        let mut wanted = Vec::new();
        for (i, light) in lights.iter().enumerate() {
            let sampled = match light {
                LightDescription::AreaLight(_) | LightDescription::Environment(_) => true,
                LightDescription::Sun(sun) => sun.angle > 0.0,
                LightDescription::PointLight(_) | LightDescription::Directional(_) => false,
            };
            any |= sampled;
            let named = || rest.iter().any(|(_, at, _)| is_within(&pointers[i], at));
            if sampled && !(is_set[i] && (!was_set[i] || named())) {
                wanted.push(i);
            }
        }
        for i in wanted {
            self.flag("--light-samples", &pointers[i], Some(samples));
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
        self.below = self.list.len() + last.below;
        self.append(last);
    }

    /// Applies all overrides to a document. Those with an error are left out: [`Overrides::load`]
    /// reports them.
    pub fn apply(&self, document: &mut Document) {
        for (_, _, set) in &self.list {
            let _ = document.apply_set(set);
        }
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
            Some((Some(flag), ..)) => Problem { place: flag.to_string(), ..problem },
            _ => problem,
        }
    }
}

/// Returns true if the JSON pointer `at` is `pointer` or leads to a value below it.
fn is_within(at: &str, pointer: &str) -> bool {
    at.strip_prefix(pointer).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
}
