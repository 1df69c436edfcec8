//! Where the settings of a job were written: in a job file or in flags.

use crate::scene::Document;

/// The job file, and whether a flag replaces its pattern of names.
#[derive(Debug, Default)]
pub struct Places {
    /// The job file; `None` if flags alone describe the job.
    pub document: Option<Document>,
    /// True if `--name` replaces `/output/name`. Values of other flags have been checked before.
    pub name_is_flag: bool,
}

impl Places {
    /// Returns the place of a key for messages: the flag that sets it, else
    /// `JOB.json:LINE:COL (/json/pointer)`. For a key that nothing sets it is the name of the key.
    pub fn at(&self, pointer: &str) -> String {
        if self.name_is_flag && pointer == "/output/name" {
            return "--name".to_string();
        }
        let written = self.document.as_ref().filter(|document| document.get(pointer).is_some());
        let name = || pointer.trim_start_matches('/').replace('/', " ");
        written.map_or_else(name, |document| document.place(pointer))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_a_flag_else_line_and_column() {
        let text = b"{ \"output\": {\n  \"fps\": 1, \"name\": \"\" } }";
        let document = Some(Document::parse("job.json", text).unwrap());
        let places = Places { document, name_is_flag: true };
        assert_eq!(places.at("/output/fps"), "job.json:2:10 (/output/fps)");
        assert_eq!(places.at("/output/name"), "--name");
        assert_eq!(places.at("/output/folder"), "output folder");
        assert_eq!(Places::default().at("/size"), "size");
    }
}
