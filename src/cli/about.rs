//! Commands that describe the program itself: `--version`, `schema`, `completions`, `man`.

use clap::CommandFactory;
use clap_complete::Shell;
use clap_mangen::Man;

use crate::batch::JobFile;
use crate::error::{Error, Result};
use crate::scene::{schema, schema_of};

use super::args::Arguments;
use super::args::SchemaName;
use super::{print, version};

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
    let mut command = Arguments::command().version(version::VERSION);
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
