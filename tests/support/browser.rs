//! Opens pages in a headless browser.

use std::{fs, path::Path, process::Command};

use super::program::skipped_outside_ci;

const BROWSERS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];

/// Opens a page and returns the browser's output. `None` if there is no browser.
pub fn browse(args: &[&str], page: &Path) -> Option<String> {
    let url = format!("file://{}", page.display());
    let all = [
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--allow-file-access-from-files",
        "--virtual-time-budget=4000",
    ];
    for browser in BROWSERS {
        match Command::new(browser).args(all).args(args).arg(&url).output() {
            Ok(output) => return Some(String::from_utf8_lossy(&output.stdout).into_owned()),
            Err(_) => continue,
        }
    }
    skipped_outside_ci(&format!("found no browser of {BROWSERS:?}"));
    None
}

/// Properties of a page in a window of a given width.
#[derive(Debug, PartialEq, serde::Deserialize)]
pub struct Seen {
    /// Width of the page in CSS pixels. If it exceeds the window's, the page scrolls sideways.
    pub width: u32,
    pub height: u32,
    /// Size of the smallest text in a chart in displayed CSS pixels; 0 without charts.
    pub chart_text: f64,
    /// Lowest contrast of a text with its background, by WCAG's formula.
    pub contrast: f64,
    /// Relative luminance of the background, 0 to 1.
    pub background: f64,
    pub errors: Vec<String>,
    pub sections: u32,
}

/// Looks at pages through frames, because a window cannot be as narrow as a telephone.
const LOOK: &str = r#"
  const seen = (page) => {
    const it = page.contentDocument, view = page.contentWindow;
    const texts = [...it.querySelectorAll('svg text')].filter((t) => t.getBoundingClientRect().width > 0);
    const size = (t) => parseFloat(view.getComputedStyle(t).fontSize) * t.getScreenCTM().a;
    const channel = (c) => (c /= 255) <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
    const rgb = (color) => color.match(/[\d.]+/g).map(Number);
    const light = (color) => {
      const [r, g, b] = rgb(color).map(channel);
      return 0.2126 * r + 0.7152 * g + 0.0722 * b;
    };
    const behind = (e) => {
      for (; e; e = e.parentElement) {
        const color = view.getComputedStyle(e).backgroundColor;
        if (rgb(color)[3] !== 0) return color;
      }
      return 'rgb(255, 255, 255)';
    };
    const all = [...texts, ...it.querySelectorAll('h1, h2, p, td, th, summary, figcaption, dt, dd, label')];
    const contrast = (e) => {
      const style = view.getComputedStyle(e);
      const [a, b] = [light(e.closest('svg') ? style.fill : style.color), light(behind(e))];
      return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    };
    return {
      width: it.documentElement.scrollWidth,
      height: it.documentElement.scrollHeight,
      chart_text: texts.length ? Math.min(...texts.map(size)) : 0,
      contrast: Math.min(...all.map(contrast)),
      background: light(behind(it.body)),
      errors: view.errors,
      sections: it.querySelectorAll('section, article').length,
    };
  };
  const pages = [...document.querySelectorAll('iframe')], all = pages.map(() => null);
  pages.forEach((page, i) => {
    page.onload = () => {
      all[i] = seen(page);
      if (all.every((one) => one)) document.body.dataset.seen = JSON.stringify(all);
    };
    page.src = page.dataset.src;
  });
"#;

/// Opens pages of a folder in windows `width` wide, with their `<details>` open if `open`. `None`
/// if there is no browser. One browser shows them all, because its start takes longest.
pub fn look(
    folder: &Path,
    pages: &[&str],
    width: u32,
    dark: bool,
    open: bool,
) -> Option<Vec<Seen>> {
    let watch = "<script>var errors = []; onerror = (text) => { errors.push(text); };</script>";
    let frames = pages.iter().map(|page| {
        let html = fs::read_to_string(folder.join(page)).unwrap();
        let html = html.replacen("<head>", &format!("<head>{watch}"), 1);
        let html = if open { html.replace("<details>", "<details open>") } else { html };
        let watched = page.replace(".html", ".watched.html");
        fs::write(folder.join(&watched), html).unwrap();
        format!(
            "<iframe data-src=\"{watched}\" style=\"border:0;width:{width}px;height:800px\"></iframe>"
        )
    });
    let frames: String = frames.collect();
    let outer = format!("<!DOCTYPE html><body>{frames}<script>{LOOK}</script></body>");
    let outer_path = folder.join("outer.html");
    fs::write(&outer_path, outer).unwrap();
    let scheme = format!("--blink-settings=preferredColorScheme={}", u8::from(!dark));
    let dom = browse(&["--dump-dom", &scheme, "--window-size=1400,900"], &outer_path)?;
    let seen = dom.split("data-seen=\"").nth(1).and_then(|rest| rest.split('"').next());
    let seen = seen.unwrap_or_else(|| panic!("{pages:?}: nothing was seen: {dom}"));
    Some(serde_json::from_str(&seen.replace("&quot;", "\"").replace("&amp;", "&")).unwrap())
}
