//! Commands that describe the program itself: `--version`, `schema`, `completions`, `man`.

use clap::{Command, CommandFactory};
use clap_complete::Shell;
use clap_mangen::Man;
use clap_mangen::roff::{Roff, bold, roman};

use crate::batch::JobFile;
use crate::error::{Error, Result};
use crate::scene::{schema, schema_of};

use super::args::{Arguments, EXIT_CODES, SchemaName};
use super::{print, version};

/// Date of this version in CHANGELOG.md, for the manual page.
const RELEASED: &str = "2026-11-30";

/// Prints the version; with `verbose`, also what the program was built from and finds here.
pub fn version(verbose: bool) -> Result<()> {
    print::text(&version::text(verbose))
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
    let mut command = without_hidden(&Arguments::command());
    clap_complete::generate(shell, &mut command, "lightpath", &mut script);
    print::text(&String::from_utf8_lossy(&script))
}

/// Returns what a completion script needs of a command. `clap_complete` would list hidden flags.
fn without_hidden(command: &Command) -> Command {
    let shown = command.get_arguments().filter(|argument| !argument.is_hide_set()).cloned();
    let kept = Command::new(command.get_name().to_string())
        .about(command.get_about().cloned().unwrap_or_default())
        .disable_version_flag(command.is_disable_version_flag_set())
        .args(shown);
    kept.subcommands(command.get_subcommands().map(without_hidden))
}

/// Prints one manual page with a section per command.
pub fn man() -> Result<()> {
    let mut page = Vec::new();
    let rendered = write_man(&mut page);
    rendered.map_err(|error| Error::io("<man page>".as_ref(), "write", &error))?;
    print::text(&String::from_utf8_lossy(&page))
}

fn write_man(page: &mut Vec<u8>) -> std::io::Result<()> {
    let mut command = Arguments::command().version(version::VERSION).disable_help_subcommand(true);
    command.build();
    let commands = below(&command);
    let man = Man::new(command.clone()).date(RELEASED);
    man.render_title(page)?;
    man.render_name_section(page)?;
    man.render_synopsis_section(page)?;
    man.render_description_section(page)?;
    man.render_options_section(page)?;
    // clap's own list names pages such as `lightpath-render(1)`, which do not exist.
    let mut list = Roff::new();
    list.control("SH", ["SUBCOMMANDS"]);
    for subcommand in &commands {
        list.control("TP", []);
        list.text([bold(name(subcommand))]);
        list.text([roman(subcommand.get_about().map(ToString::to_string).unwrap_or_default())]);
    }
    list.control("SH", ["EXIT STATUS"]);
    list.text([roman(EXIT_CODES)]);
    list.to_writer(page)?;
    man.render_version_section(page)?;
    for subcommand in commands {
        page.extend(format!(".SH {}\n", name(subcommand).to_uppercase()).as_bytes());
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

/// Returns the subcommands of a command, each followed by its own.
fn below(command: &Command) -> Vec<&Command> {
    let with_own = |sub| std::iter::once(sub).chain(below(sub));
    command.get_subcommands().flat_map(with_own).collect()
}

/// Returns the words that start a command: `lightpath submit slurm`.
fn name(command: &Command) -> &str {
    command.get_bin_name().unwrap_or_else(|| command.get_name())
}
