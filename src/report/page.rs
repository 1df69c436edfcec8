//! A self-contained HTML file with sections of charts, tables and text.

use std::fmt::Write;

use super::svg::escape;

/// An HTML page: a heading, lines of introduction and sections.
#[derive(Debug, Clone, Default)]
pub struct Page {
    /// Heading of the page and title of the file.
    pub title: String,
    /// Paragraphs below the heading.
    pub intro: Vec<String>,
    /// The sections from top to bottom.
    pub sections: Vec<Section>,
}

/// One section of a page.
#[derive(Debug, Clone, Default)]
pub struct Section {
    /// Heading of the section.
    pub title: String,
    /// Conclusions in large type: the text and whether it is bad, which makes it red.
    pub findings: Vec<(String, bool)>,
    /// Charts as SVG or HTML. Empty strings are left out.
    pub charts: Vec<String>,
    /// Titles and rows of tables. The first row is the header. All but the first table are folded.
    pub tables: Vec<(String, Vec<Vec<Cell>>)>,
    /// Whether charts and tables are folded, so that only heading and findings show at first.
    pub folded: bool,
}

/// One cell of a table.
#[derive(Debug, Clone, Default)]
pub struct Cell {
    /// The text, not escaped.
    pub text: String,
    /// Whether the text is red.
    pub wrong: bool,
}

impl<T: Into<String>> From<T> for Cell {
    fn from(text: T) -> Self {
        Self { text: text.into(), wrong: false }
    }
}

/// The style sheet of every page.
///
/// Charts set colours as attributes of their elements. The style sheet replaces the colours that
/// are unreadable on a dark background.
const STYLE: &str = include_str!("page.css");

impl Page {
    /// Returns the HTML of the page, with its style sheet.
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

    #[test]
    fn the_style_replaces_the_colours_of_the_charts() {
        for color in [GRID, AXIS, INK] {
            assert!(STYLE.contains(&format!("[stroke=\"{color}\"]")), "{color}");
        }
        assert!(COLORS.contains(&INK) && STYLE.contains(&format!("[fill=\"{INK}\"]")));
    }

    #[test]
    fn a_page_is_complete_and_refers_to_no_other_file() {
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
