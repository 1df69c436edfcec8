//! `lightpath completions` and `lightpath man`, generated from the same table as the help.

use clap::CommandFactory;
use clap_complete::Shell;
use clap_mangen::Man;

use crate::error::{Error, Result};

use super::args::Arguments;

/// Prints a completion script for a shell.
pub fn completions(shell: Shell) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Arguments::command(), "lightpath", &mut script);
    super::print(&String::from_utf8_lossy(&script))
}

/// Prints one manual page with a section per command.
pub fn man() -> Result<()> {
    let mut page = Vec::new();
    let rendered = render(&mut page);
    rendered.map_err(|error| Error::io("<man page>".as_ref(), "write", &error))?;
    super::print(&String::from_utf8_lossy(&page))
}

fn render(page: &mut Vec<u8>) -> std::io::Result<()> {
    let mut command = Arguments::command().version(super::version::VERSION);
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
