//! Parts of a picture: `--tile`, `--samples`, `--part`, and the EXR attribute that `merge` reads.

use std::ops::Range;

use crate::accel::BuildInfo;
use crate::error::{Error, ErrorKind, Problem, Result};
use crate::film::{Channel, Window};
use crate::integrate::Pattern;
use crate::layers::{LayerPlan, PartialSumsLayout, PixelLayout};
use crate::merge::{PartDescription, PictureFormat, part};
use crate::output::legend::Legend;
use crate::picture::Storage;
use crate::render::checked_overscan;
use crate::scene::{Backend, Scene};
use crate::units::plural;

use super::args::RenderArgs;

/// The part of the picture that this render makes.
#[derive(Debug)]
pub struct PicturePart {
    /// Pixels of the whole picture that the parts form.
    whole: Window,
    /// Pixels of this part.
    pub window: Window,
    /// Width of the overscan in pixels, a multiple of the tile's side. The top left corner of the
    /// overscan is the origin of the windows.
    pub overscan: u32,
    samples: Range<u32>,
    /// The tile and the number of tiles, if the picture is split into tiles.
    tile: Option<[u32; 2]>,
    /// True if the EXR must keep every bit.
    pub exact: bool,
    /// True if the PNG shows a plate.
    over: bool,
    /// Layers of the merged picture.
    layout: PixelLayout,
    /// Layout of partial sums in the EXR; `None` if all samples are rendered.
    pub raw: Option<PartialSumsLayout>,
}

impl PicturePart {
    /// Determines the part from the flags.
    ///
    /// # Errors
    /// Tiles and samples that the picture does not have; flags that only work for a whole picture.
    pub fn new(args: &RenderArgs, scene: &Scene, plan: &LayerPlan) -> Result<Self> {
        let split = &args.split;
        let (overscan, whole) = match args.scene.overscan.unwrap_or(0) {
            0 => (0, window(args.scene.crop.as_deref(), scene)?),
            pixels => checked_overscan(pixels, &scene.camera)?,
        };
        let window = match split.tile {
            Some([i, n]) if n <= whole.height() => part::band(whole, i, n),
            Some([_, n]) => {
                let message = format!("found {n} tiles, expected at most {}", whole.height());
                return Err(Error::invalid("--tile", message).help("a tile has one row or more"));
            }
            None => whole,
        };
        let spp = scene.spp;
        if let Some(of) = split.of.filter(|of| *of != spp) {
            let message =
                format!("found {of}, but --spp or --set sets {}", plural(spp as usize, "sample"));
            return Err(Error::invalid("--of", message).help("leave out --spp: --of replaces it"));
        }
        let samples = match split.samples {
            Some([a, b]) if b > spp => {
                let message = format!("found {a}..{b}, expected samples within 0..{spp}");
                return Err(
                    Error::invalid("--samples", message).help("--of N for a picture of N samples")
                );
            }
            Some([a, b]) => a..b,
            None => 0..spp,
        };
        refuse_cut_packets(&samples, scene)?;
        let layout = plan.layout.clone();
        let raw = (samples != (0..spp)).then(|| PartialSumsLayout::new(&layout, samples.clone()));
        let is_split = split.tile.is_some() || split.samples.is_some();
        let (tile, exact) = (split.tile, split.part || is_split);
        let over = args.files.plate.over.is_some();
        let piece = Self { whole, window, overscan, samples, tile, exact, over, layout, raw };
        let frame = Window::full(scene.camera.width, scene.camera.height);
        // A crop alone is a part of the frame. With `--tile` or `--samples` the whole is the crop.
        let piece = if is_split || overscan > 0 { piece } else { Self { whole: frame, ..piece } };
        if piece.exact {
            let for_merge = "give it to `lightpath merge`";
            let set = [
                ("--png-layer", !args.files.png_layer.is_empty(), for_merge),
                ("--crypto-sidecar", args.files.prefix.crypto_sidecar, for_merge),
                (
                    "--visible-faces",
                    args.files.dataset.visible_faces.is_some(),
                    "the samples of a part are not all: render the picture at once",
                ),
                ("--png-ids", args.files.dataset.png_ids, "render the picture at once"),
                ("--over", over, "the plate is as large as the frame: put the merged EXR over it"),
                ("--overscan", overscan > 0, "parts are pieces of the frame: render it at once"),
                (
                    "--time",
                    args.sampling.time.is_some(),
                    "no two runs make the same picture: use --noise without --time",
                ),
            ];
            if let Some((flag, _, help)) = set.into_iter().find(|(_, set, _)| *set) {
                let message = "found with a part of a picture, expected with the whole";
                return Err(Error::invalid(flag, message).help(help));
            }
        }
        if overscan > 0 && over {
            let message = "found with --overscan, expected a picture of the frame alone";
            return Err(Error::invalid("--over", message));
        }
        if args.files.dataset.visible_faces.is_some() && args.sampling.time.is_some() {
            let message = "found with --time, which would hold every sample of every pixel";
            return Err(Error::invalid("--visible-faces", message).help("use --noise or --spp"));
        }
        Ok(piece)
    }

    /// Returns the channels of the film besides R, G, B, A.
    pub fn channels(&self) -> Vec<Channel> {
        self.raw.as_ref().map_or_else(|| self.layout.channels.clone(), PartialSumsLayout::channels)
    }

    /// Returns the attribute that `merge` reads, or `None` for a whole picture. `fingerprint` is
    /// the hash of the scene and its files, `legend` that of its colour map, and `storage` the
    /// format of the merged picture.
    ///
    /// # Errors
    /// A failure to serialise, which cannot occur with the present types.
    pub fn attribute(
        &self,
        storage: Storage,
        scene: &Scene,
        info: &BuildInfo,
        (fingerprint, legend): (Option<&str>, Option<&Legend>),
    ) -> Result<Option<(String, String)>> {
        if !self.exact && self.window == self.whole {
            return Ok(None);
        }
        let files = PictureFormat {
            float: storage.float,
            compression: storage.compression,
            multipart: storage.multipart,
            depth: storage.depth,
            transparent: scene.has_alpha(),
            legend: legend.filter(|_| scene.legend).cloned(),
            over: self.over,
            ..PictureFormat::new(&scene.tonemap)
        };
        let Window { x0, y0, x1, y1 } = self.whole;
        let part = PartDescription {
            fingerprint: fingerprint.map(str::to_string),
            isa: matches!(scene.backend, Backend::Embree(_)).then(|| info.isa.clone()),
            whole: [x0, y0, x1, y1],
            tile: self.tile,
            samples: [self.samples.start, self.samples.end],
            of: scene.spp,
            exact: self.exact || storage.float && !storage.compression.is_lossy(),
            files,
            layout: self.layout.clone(),
        };
        Ok(Some((part::ATTRIBUTE.to_string(), part.text()?)))
    }
}

/// Returns the window of pixels to render.
///
/// # Errors
/// A crop that is empty or exceeds the frame.
fn window(crop: Option<&[u32]>, scene: &Scene) -> Result<Window> {
    let (width, height) = (scene.camera.width, scene.camera.height);
    let Some([x0, y0, x1, y1]) = crop.and_then(|c| <[u32; 4]>::try_from(c).ok()) else {
        return Ok(Window::full(width, height));
    };
    let found = format!("found {x0} {y0} {x1} {y1}");
    let wrong = match (x0 < x1 && y0 < y1, x1 <= width && y1 <= height) {
        (true, true) => return Ok(Window { x0, y0, x1, y1 }),
        (false, _) => format!("{found}, which is empty, expected X0 < X1 and Y0 < Y1"),
        (_, false) => format!("{found}, expected pixels within the frame of {width} x {height}"),
    };
    Err(Error::new(ErrorKind::Invalid, Problem::new("--crop", wrong)))
}

/// Refuses a range of samples that cuts a packet if the light of a sample depends on the packet:
/// adaptive shadows decide about whole packets, and no light is drawn for packets with a shadow
/// catcher.
///
/// # Errors
/// `Invalid` for such a range.
fn refuse_cut_packets(samples: &Range<u32>, scene: &Scene) -> Result<()> {
    let packet = Pattern::for_spp(scene.spp).samples;
    let cut = |at: u32| at % packet != 0 && at != scene.spp;
    let Range { start, end } = *samples;
    let together = if scene.can_skip_shadow_rays() {
        "adaptive shadows decide about"
    } else if scene.draws_lights() && scene.has_catchers() {
        "with a shadow catcher, emittersamples draws lights for"
    } else {
        return Ok(());
    };
    if !(cut(start) || cut(end)) {
        return Ok(());
    }
    let message = format!(
        "found {start}..{end}, expected multiples of {packet} or the end, {}: {together} {packet} \
         samples of a pixel together",
        scene.spp
    );
    let start = start / packet * packet;
    let [below, above] = [end / packet * packet, end.next_multiple_of(packet).min(scene.spp)];
    let help = match below > start && below != above {
        true => format!("{start}..{below} or {start}..{above}"),
        false => format!("{start}..{above}"),
    };
    Err(Error::invalid("--samples", message).help(help))
}
