//! One HTML file that needs no other: sections of charts, tables and text.

use std::fmt::Write;

use super::svg::escape;

/// A page.
#[derive(Debug, Clone, Default)]
pub struct Page {
    /// Heading.
    pub title: String,
    /// Below it.
    pub intro: Vec<String>,
    /// From top to bottom.
    pub sections: Vec<Section>,
}

/// A part of a page.
#[derive(Debug, Clone, Default)]
pub struct Section {
    /// Heading.
    pub title: String,
    /// The answer, in large type: text and whether it is bad.
    pub findings: Vec<(String, bool)>,
    /// SVG; empty ones are left out.
    pub charts: Vec<String>,
    /// Titles and rows of tables; the first row is the head. All but the first table are folded.
    pub tables: Vec<(String, Vec<Vec<Cell>>)>,
    /// Only heading and findings show until somebody asks for the rest.
    pub folded: bool,
}

/// One cell of a table.
#[derive(Debug, Clone, Default)]
pub struct Cell {
    /// What it says.
    pub text: String,
    /// Shown in red.
    pub wrong: bool,
}

impl<T: Into<String>> From<T> for Cell {
    fn from(text: T) -> Self {
        Self { text: text.into(), wrong: false }
    }
}

/// Colours of charts are attributes of their elements: the style replaces those that would not show in the dark.
const STYLE: &str = include_str!("page.css");

impl Page {
    /// The file.
    pub fn html(&self) -> String {
        let mut html = String::new();
        let title = escape(&self.title);
        let _ = write!(
            html,
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n"
        );
        for line in &self.intro {
            let _ = writeln!(html, "<p class=\"intro\">{}</p>", escape(line));
        }
        for section in &self.sections {
            section.write(&mut html);
        }
        html.push_str("</body>\n</html>\n");
        html
    }
}

impl Section {
    fn write(&self, html: &mut String) {
        let _ = writeln!(html, "<section>\n<h2>{}</h2>", escape(&self.title));
        for (text, bad) in &self.findings {
            let class = if *bad { "finding bad" } else { "finding" };
            let _ = writeln!(html, "<p class=\"{class}\">{}</p>", escape(text));
        }
        if self.folded {
            html.push_str("<details><summary>Charts and tables</summary>\n");
        }
        html.push_str("<div class=\"charts\">\n");
        for chart in self.charts.iter().filter(|chart| !chart.is_empty()) {
            let _ = writeln!(html, "<div>{chart}</div>");
        }
        html.push_str("</div>\n");
        for (t, (title, rows)) in self.tables.iter().enumerate() {
            let (open, title) = (if t == 0 { " open" } else { "" }, escape(title));
            let _ = writeln!(html, "<details{open}><summary>{title}</summary>");
            html.push_str("<div class=\"scroll\"><table>\n");
            for (i, row) in rows.iter().enumerate() {
                let tag = if i == 0 { "th" } else { "td" };
                html.push_str("<tr>");
                for cell in row {
                    let class = if cell.wrong { " class=\"wrong\"" } else { "" };
                    let _ = write!(html, "<{tag}{class}>{}</{tag}>", escape(&cell.text));
                }
                html.push_str("</tr>\n");
            }
            html.push_str("</table></div>\n</details>\n");
        }
        html.push_str(if self.folded { "</details>\n</section>\n" } else { "</section>\n" });
    }
}

#[cfg(test)]
mod tests {
    use super::super::svg::{AXIS, COLORS, GRID, INK};
    use super::*;

    /// The colours that the style replaces are those of the charts.
    #[test]
    fn the_style_knows_the_colours_of_the_charts() {
        for color in [GRID, AXIS, INK] {
            assert!(STYLE.contains(&format!("[stroke=\"{color}\"]")), "{color}");
        }
        assert!(COLORS.contains(&INK) && STYLE.contains(&format!("[fill=\"{INK}\"]")));
    }

    #[test]
    fn a_page_is_whole_and_refers_to_nothing() {
        let wrong = Cell { text: "<b>".into(), wrong: true };
        let section = Section {
            title: "A & B".into(),
            findings: vec![("good".into(), false), ("bad".into(), true)],
            charts: vec![String::new(), "<svg></svg>".into()],
            tables: vec![("T".into(), vec![vec!["head".into()], vec![wrong]])],
            folded: true,
        };
        let page = Page { title: "x".into(), intro: vec![], sections: vec![section] };
        let html = page.html();
        assert!(html.starts_with("<!DOCTYPE html>") && html.ends_with("</html>\n"));
        assert!(html.contains("<td class=\"wrong\">&lt;b&gt;</td>"));
        assert!(html.contains("A &amp; B") && html.contains("finding bad"));
        for outside in ["src=", "href=", "@import", "url("] {
            assert!(!html.contains(outside), "{outside}");
        }
        assert_eq!(html.matches("<div><svg>").count(), 1);
        assert_eq!(html.matches("<details").count(), html.matches("</details>").count());
        assert!(html.find("finding bad") < html.find("<details"));
    }
}
