//! Reads files from beginning to end through a window. It serves compressed files, pipes, and files
//! that are not mapped. In addition to the arrays, only the window and the chunks read ahead take
//! memory. The window grows only for a row that is longer.
//!
//! A separate thread reads and unpacks ahead. A window moves over the data. The complete rows in
//! the window are located and read by the same code as in a whole file. One kind of file is loaded
//! completely first: a file whose faces come before its vertices.

use std::io::Read;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use super::block::{Span, too_short};
use super::context::ReadContext;
use super::face;
use super::faces::PlyFaces;
use super::finish::{ParsedFile, finish};
use super::header::{self, Element, Format, Header, MAX_HEADER};
use super::layout::BinaryRows;
use super::lines::Lines;
use super::options::ReadOptions;
use super::plan::{self, MeshPlan};
use super::table::Table;
use super::unused::UnusedElement;
use super::vertex::{self, PlyVertices};
use super::whole::whole;
use crate::error::{Error, Result};
use crate::mesh::arrays::{Mesh, Positions};
use crate::reserve;
use crate::units::plural;

/// Number of bytes in one chunk.
const CHUNK: usize = 1 << 21;
/// Number of chunks that the thread may read ahead.
const AHEAD: usize = 2;
/// Interval at which a waiting reader checks for a stop request.
const POLL_INTERVAL: Duration = Duration::from_millis(100);
/// Maximum number of rows of an element to reserve memory for at once, if the length of the file is
/// unknown.
const MAX_UNVERIFIED_ROWS: u64 = 1 << 16;

/// Converts an I/O error of the stream to an error about the file.
type Failed<'a> = &'a dyn Fn(&std::io::Error) -> Error;

/// Reads a mesh from a stream on two threads. `length` is the number of bytes, if known.
pub(super) fn read(
    mut bytes: Box<dyn Read + Send>,
    length: Option<u64>,
    failed: Failed,
    context: &ReadContext,
    options: ReadOptions,
) -> Result<Mesh> {
    let (sender, chunks) = sync_channel(AHEAD);
    let size = options.window.clamp(1, CHUNK);
    // The thread ends when the receiver is dropped. It is not joined: a pipe may block forever.
    let thread = std::thread::Builder::new().name("ply".into());
    thread.spawn(move || pump(&mut bytes, size, &sender)).map_err(|error| failed(&error))?;
    ReadWindow::new(chunks, options, failed).mesh(length, context, options)
}

type Chunk = std::io::Result<Vec<u8>>;

/// Reads the next `size` bytes, or fewer if the data ends first.
fn chunk(bytes: &mut dyn Read, size: usize) -> Chunk {
    let mut chunk = Vec::new();
    chunk.try_reserve_exact(size)?;
    bytes.take(size as u64).read_to_end(&mut chunk)?;
    Ok(chunk)
}

/// Sends all of `bytes` in chunks, then an empty chunk.
fn pump(bytes: &mut dyn Read, size: usize, sender: &SyncSender<Chunk>) {
    loop {
        let next = chunk(bytes, size);
        let last = next.as_ref().map_or(true, Vec::is_empty);
        if sender.send(next).is_err() || last {
            return;
        }
    }
}

/// Waits for the next chunk. It is empty after the end of the data.
fn next(chunks: &Receiver<Chunk>, context: &ReadContext) -> Result<Chunk> {
    loop {
        context.check()?;
        match chunks.recv_timeout(POLL_INTERVAL) {
            Ok(chunk) => return Ok(chunk),
            Err(RecvTimeoutError::Timeout) => {}
            // The thread sends an empty chunk or an error before it ends.
            Err(RecvTimeoutError::Disconnected) => return Ok(Ok(Vec::new())),
        }
    }
}

/// The part of the file that is in memory.
struct ReadWindow<'a> {
    bytes: Vec<u8>,
    /// Offset of the first byte that has not been consumed.
    at: usize,
    /// Number of bytes consumed so far.
    taken: u64,
    chunks: Receiver<Chunk>,
    ended: bool,
    failed: Failed<'a>,
    /// Number of bytes with which the window is filled before rows are read. Longer rows need more.
    size: usize,
    /// The lines of text from this offset on, until the window moves.
    lines: Option<(usize, Lines)>,
}

/// Rows in the window.
struct LocatedRows {
    /// Offset of the data to which `span` and `end` refer.
    start: usize,
    span: Span,
    end: usize,
}

impl<'a> ReadWindow<'a> {
    fn new(chunks: Receiver<Chunk>, options: ReadOptions, failed: Failed<'a>) -> Self {
        let size = options.window.max(1);
        let (bytes, ended, lines) = (Vec::new(), false, None);
        Self { bytes, at: 0, taken: 0, chunks, ended, failed, size, lines }
    }

    fn data(&self) -> &[u8] {
        &self.bytes[self.at..]
    }

    fn take(&mut self, bytes: usize) {
        self.at += bytes;
        self.taken += bytes as u64;
    }

    /// Reads until the window holds at least `bytes` unconsumed bytes, or the file ends.
    fn fill(&mut self, bytes: usize, context: &ReadContext) -> Result<()> {
        if !self.ended && self.data().len() < bytes {
            self.bytes.drain(..self.at);
            self.at = 0;
            self.lines = None;
        }
        while !self.ended && self.data().len() < bytes {
            let chunk = next(&self.chunks, context)?.map_err(|error| (self.failed)(&error))?;
            self.ended = chunk.is_empty();
            if self.bytes.is_empty() {
                self.bytes = chunk;
            } else {
                context.fits((self.bytes.len() + chunk.len()) as u64)?;
                reserve::growing(&mut self.bytes, chunk.len(), context.name)?;
                self.bytes.extend_from_slice(&chunk);
            }
        }
        Ok(())
    }

    /// Reads the header and all rows, and makes the mesh.
    fn mesh(
        mut self,
        length: Option<u64>,
        context: &ReadContext,
        options: ReadOptions,
    ) -> Result<Mesh> {
        self.fill(1, context)?;
        while !header::is_complete(self.data()) && !self.ended && self.data().len() <= MAX_HEADER {
            self.fill(2 * self.data().len(), context)?;
        }
        let header = header::parse(self.data(), context.name)?;
        let plan = plan::plan(&header, context.name, &options)?;
        if plan.faces.iter().any(|face| face.element < plan.vertex.element) {
            // Faces can only be checked after the vertices are read.
            self.fill(usize::MAX, context)?;
            return whole(self.data(), context, options);
        }
        self.take(header.data_start);
        let mut partial = PartialMesh {
            vertices: empty_vertices(&header, &plan, context)?,
            faces: PlyFaces::default(),
        };
        let mut line = header.lines;
        for (index, element) in header.elements.iter().enumerate() {
            let mut row = 0;
            let mut need = self.size;
            while row < element.count {
                self.fill(need, context)?;
                let LocatedRows { start, span, end } =
                    self.next_rows(&header, element, row, &mut line, context)?;
                let (rows, data) = (span.rows, &self.bytes[start..]);
                let big = header.format.is_big();
                let table = Table { data, big, span: &span, element, context: *context };
                partial.read(&table, index, &plan, &header, length)?;
                row += rows;
                self.take(start + end - self.at);
                if rows == 0 && row < element.count {
                    if self.ended {
                        let have =
                            format!("the data ends after {}", plural(self.taken as usize, "byte"));
                        return Err(too_short(element, row, &have, context));
                    }
                    // The row is longer than the window.
                    need = 2 * self.data().len().max(self.size);
                }
            }
        }
        let trailing_bytes = self.trailing(header.format, context)?;
        let PartialMesh { vertices, faces } = partial;
        finish(ParsedFile { header, plan, vertices, faces, trailing_bytes }, context, options)
    }

    /// Locates the next complete rows of `element` in the window, from row `row` on. `line` is the
    /// number of lines of text before the window's data; it is moved to the end of the rows.
    fn next_rows(
        &mut self,
        header: &Header,
        element: &Element,
        row: u64,
        line: &mut u64,
        context: &ReadContext,
    ) -> Result<LocatedRows> {
        let (start, data) = (self.at, &self.bytes[self.at..]);
        let wanted = element.count - row;
        if header.format != Format::Ascii {
            let big = header.format == Format::Big;
            let (span, end) = BinaryRows { data, element, big, context }.rows(0, row, wanted)?;
            return Ok(LocatedRows { start, span, end });
        }
        let (start, lines) = match &mut self.lines {
            Some((start, lines)) => (*start, lines),
            none => {
                let whole_lines = match self.ended {
                    true => data.len(),
                    false => data.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1),
                };
                let lines = Lines::new(&data[..whole_lines], *line, context)?;
                (start, &mut none.insert((start, lines)).1)
            }
        };
        let span = lines.take(&self.bytes[start..], element, row, wanted);
        let (end, after) = lines.position();
        *line = after;
        Ok(LocatedRows { start, span, end })
    }

    /// Consumes the rest of the file. Returns the number of bytes after the last row. In text,
    /// white space directly after the last row does not count.
    fn trailing(&mut self, format: Format, context: &ReadContext) -> Result<u64> {
        let mut trailing = 0u64;
        loop {
            let data = self.data();
            let blank = match (format, trailing) {
                (Format::Ascii, 0) => data.iter().take_while(|b| b.is_ascii_whitespace()).count(),
                _ => 0,
            };
            trailing += (data.len() - blank) as u64;
            self.take(data.len());
            if self.ended {
                return Ok(trailing);
            }
            self.fill(1, context)?;
        }
    }
}

/// The arrays that have been read so far.
struct PartialMesh {
    vertices: PlyVertices,
    faces: PlyFaces,
}

impl PartialMesh {
    /// Appends the rows of `table`, which belong to the element with index `index`. Rows of other
    /// elements are checked in text and ignored in binary data.
    fn read(
        &mut self,
        table: &Table,
        index: usize,
        plan: &MeshPlan,
        header: &Header,
        length: Option<u64>,
    ) -> Result<()> {
        if index == plan.vertex.element {
            let context = &table.context;
            let count = plausible_rows(table.element, length);
            self.vertices.reserve(count, &plan.vertex, context)?;
            self.vertices.append(vertex::read(table, &plan.vertex)?, context)?;
        } else if let Some(part) = plan.faces.iter().find(|face| face.element == index) {
            let next = match &self.vertices.positions {
                Positions::F32(positions) => face::read(table, part, positions)?,
                Positions::F64(positions) => face::read(table, part, positions)?,
            };
            if self.faces.triangles.is_empty() && !part.strips {
                // `plausible_rows` counts lists as empty, but a triangle has three items. So fewer
                // rows fit.
                let length = length.map(|length| length / 2);
                let count = plausible_rows(table.element, length);
                reserve::exact(&mut self.faces.triangles, count, table.context.name)?;
            }
            self.faces.append(next, &table.context)?;
            table.context.fits(self.vertices.bytes().saturating_add(self.faces.bytes()))?;
        } else if header.format == Format::Ascii {
            table.blocks(|reader| reader.feed(&mut UnusedElement(table.element)), Ok)?;
        }
        Ok(())
    }
}

/// Returns the number of rows of `element` to reserve memory for: the declared count, limited by
/// the number of binary rows that fit into `length` bytes. For text it is only an estimate.
fn plausible_rows(element: &Element, length: Option<u64>) -> usize {
    let row: u64 = element.properties.iter().map(|p| p.shape.min_bytes()).sum();
    let limit = length.map_or(MAX_UNVERIFIED_ROWS, |length| length / row.max(1));
    element.count.min(limit) as usize
}

/// Returns the arrays that the plan selects, without a vertex.
fn empty_vertices(header: &Header, plan: &MeshPlan, context: &ReadContext) -> Result<PlyVertices> {
    let element = &header.elements[plan.vertex.element];
    let big = header.format.is_big();
    let table = Table { data: &[], big, span: &Span::default(), element, context: *context };
    vertex::read(&table, &plan.vertex)
}
