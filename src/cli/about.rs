//! Commands that describe the program itself: `--version`, `schema`, `completions`, `man`.

use std::collections::BTreeMap;

use clap::CommandFactory;
use clap_complete::Shell;
use clap_mangen::Man;

use crate::{
    batch::JobFile,
    error::{Error, Result},
    scene::{schema, schema_of},
    simd::Isa,
};

use super::{args::Arguments, names::SchemaName, print};

/// Version of this crate.
const VERSION: &str = env!("CARGO_PKG_VERSION");
const COMMIT: Option<&str> = option_env!("LIGHTPATH_GIT_COMMIT");
const RUSTC: Option<&str> = option_env!("LIGHTPATH_RUSTC_VERSION");

/// Returns the text of `--version`.
pub fn version(verbose: bool) -> String {
    let mut text = format!("lightpath {VERSION}\n");
    if !verbose {
        return text;
    }
    let tiers: Vec<String> = Isa::compiled().iter().map(Isa::to_string).collect();
    let lines = [
        ("commit", COMMIT.unwrap_or("unknown").to_string()),
        ("rustc", RUSTC.unwrap_or("unknown").to_string()),
        ("embree", embree()),
        ("kernels", format!("{} (compiled in: {})", Isa::detect(), tiers.join(", "))),
    ];
    for (name, value) in lines {
        text.push_str(&format!("{name}: {value}\n"));
    }
    text
}

/// Returns the versions for the statistics of a render or measurement.
pub fn versions(backend: &str) -> BTreeMap<String, String> {
    let pairs = [
        ("lightpath", VERSION),
        ("commit", COMMIT.unwrap_or("unknown")),
        ("rustc", RUSTC.unwrap_or("unknown")),
        ("backend", backend),
    ];
    pairs.map(|(k, v)| (k.to_string(), v.to_string())).into()
}

/// Returns the version of Embree and its instruction set, or why it cannot be used.
#[cfg(feature = "embree")]
fn embree() -> String {
    match crate::accel::embree::describe() {
        Ok((version, isa)) => format!("{version} ({isa})"),
        Err(error) => match error.problems.first() {
            Some(problem) => format!("not available: {}", problem.message),
            None => "not available".to_string(),
        },
    }
}

#[cfg(not(feature = "embree"))]
fn embree() -> String {
    "not compiled in".to_string()
}

/// Prints the schema of one kind of file.
pub fn schemas(of: SchemaName) -> Result<()> {
    // The alternate format of a JSON value is indented.
    print::text(&match of {
        SchemaName::Scene => format!("{:#}\n", schema()),
        SchemaName::Job => format!("{:#}\n", schema_of::<JobFile>("lightpath job")),
    })
}

/// Prints a completion script for a shell.
pub fn completions(shell: Shell) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Arguments::command(), "lightpath", &mut script);
    print::text(&String::from_utf8_lossy(&script))
}

/// Prints one manual page with a section per command.
pub fn man() -> Result<()> {
    let mut page = Vec::new();
    let rendered = write_man(&mut page);
    rendered.map_err(|error| Error::io("<man page>".as_ref(), "write", &error))?;
    print::text(&String::from_utf8_lossy(&page))
}

fn write_man(page: &mut Vec<u8>) -> std::io::Result<()> {
    let mut command = Arguments::command().version(VERSION);
    command.build();
    Man::new(command.clone()).render(page)?;
    for subcommand in command.get_subcommands().filter(|c| c.get_name() != "help") {
        let title = format!(".SH LIGHTPATH {}\n", subcommand.get_name().to_uppercase());
        page.extend(title.as_bytes());
        let man = Man::new(subcommand.clone());
        let mut sections = Vec::new();
        man.render_synopsis_section(&mut sections)?;
        man.render_description_section(&mut sections)?;
        man.render_options_section(&mut sections)?;
        // Make the command's sections subsections.
        page.extend(String::from_utf8_lossy(&sections).replace(".SH ", ".SS ").as_bytes());
    }
    Ok(())
}
