//! Charts and pages: draws numbers as SVG charts, and writes them into one self-contained HTML
//! file.

mod bars;
mod color_scale;
mod lines;
mod page;
mod picture;
mod ratios;
mod svg;

pub use bars::{Bar, BarGroup, Bars};
pub use color_scale::ColorScale;
pub use lines::{ChartLine, LineChart};
pub use page::{Cell, Page, Section};
pub use picture::{picture, picture_of_width};
pub use ratios::{Ratio, Ratios};
pub use svg::escape;
