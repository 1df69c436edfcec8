//! Files that can only be read from beginning to end, in memory of a fixed size beside the arrays:
//! compressed ones, pipes, and those that shall not be mapped.
//!
//! A thread of its own reads (and unpacks) ahead; a window of the data moves over the file, and the
//! complete rows in it are found and read as those of a whole file are. Only a file whose faces
//! come before its vertices is read to its end first.

use std::io::Read;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use super::block::{Span, too_short};
use super::face::{self, Faces};
use super::header::{self, Element, Format, Header, MAX_HEADER};
use super::job::Job;
use super::lines::Lines;
use super::plan::{self, Plan};
use super::source::has_header;
use super::table::Table;
use super::vertex::{self, Vertices};
use super::{Found, ReadOptions, Unread, finish, layout, whole};
use crate::error::{Error, Result};
use crate::mesh::{Mesh, Positions};

/// Bytes that are read at once.
const CHUNK: usize = 1 << 21;
/// Chunks that wait to be taken.
const AHEAD: usize = 2;
/// Bytes in which rows are looked for at first; rows of more bytes make it grow.
const WINDOW: usize = 1 << 23;
/// Most rows that are believed in before they have been seen.
const UNSEEN: u64 = 1 << 16;

/// Why a stream ended early.
type Failed<'a> = &'a (dyn Fn(&std::io::Error) -> Error + Sync);

/// Reads a mesh from `bytes`, of which there are `length` if that is known.
pub(super) fn read(
    bytes: impl Read + Send,
    length: Option<u64>,
    failed: Failed,
    job: &Job,
    options: ReadOptions,
) -> Result<Mesh> {
    std::thread::scope(|scope| {
        let (sender, chunks) = sync_channel(AHEAD);
        scope.spawn(move || pump(bytes, &sender));
        let window = Window { bytes: Vec::new(), at: 0, taken: 0, chunks, ended: false, failed };
        // Returning drops the receiver, which ends the thread.
        mesh(window, length, job, options)
    })
}

type Chunk = std::io::Result<Vec<u8>>;

/// Sends all of `bytes`, then an empty chunk.
fn pump(mut bytes: impl Read, sender: &SyncSender<Chunk>) {
    loop {
        let mut chunk = Vec::with_capacity(CHUNK);
        let read = bytes.by_ref().take(CHUNK as u64).read_to_end(&mut chunk);
        let last = !matches!(read, Ok(1..));
        if sender.send(read.map(|_| chunk)).is_err() || last {
            return;
        }
    }
}

/// The part of the file that is in memory.
struct Window<'a> {
    bytes: Vec<u8>,
    /// Where the data begins that has not been taken.
    at: usize,
    /// Bytes taken so far.
    taken: u64,
    chunks: Receiver<Chunk>,
    ended: bool,
    failed: Failed<'a>,
}

impl Window<'_> {
    fn data(&self) -> &[u8] {
        &self.bytes[self.at..]
    }

    fn take(&mut self, bytes: usize) {
        self.at += bytes;
        self.taken += bytes as u64;
    }

    /// Reads on until there are at least `bytes`, or the file ends.
    fn fill(&mut self, bytes: usize, job: &Job) -> Result<()> {
        if !self.ended && self.data().len() < bytes {
            self.bytes.drain(..self.at);
            self.at = 0;
        }
        while !self.ended && self.data().len() < bytes {
            job.check()?;
            // The thread sends an empty chunk or an error before it ends.
            let chunk = self.chunks.recv().unwrap_or_else(|_| Ok(Vec::new()));
            let chunk = chunk.map_err(|error| (self.failed)(&error))?;
            self.ended = chunk.is_empty();
            match self.bytes.is_empty() {
                true => self.bytes = chunk,
                false => self.bytes.extend_from_slice(&chunk),
            }
        }
        Ok(())
    }
}

fn mesh(
    mut window: Window,
    length: Option<u64>,
    job: &Job,
    options: ReadOptions,
) -> Result<Mesh> {
    window.fill(1, job)?;
    while !has_header(window.data()) && !window.ended && window.data().len() <= MAX_HEADER {
        window.fill(2 * window.data().len(), job)?;
    }
    let header = header::parse(window.data(), job.name)?;
    let plan = plan::plan(&header, job.name)?;
    if plan.faces.iter().any(|face| face.element < plan.vertex.element) {
        // Faces are checked against the vertices.
        window.fill(usize::MAX, job)?;
        return whole(window.data(), job, options);
    }
    window.take(header.data_start);
    let mut parts = Parts { vertices: none(&header, &plan, job)?, faces: Faces::default() };
    let mut line = header.lines;
    for (index, element) in header.elements.iter().enumerate() {
        let mut row = 0;
        let mut need = WINDOW;
        while row < element.count {
            window.fill(need, job)?;
            let data = window.data();
            let (span, end) = next_rows(data, window.ended, &header, element, row, &mut line, job)?;
            let rows = span.rows;
            let big = header.format.is_big();
            let table = Table { data, big, span: &span, element, job: *job };
            parts.read(&table, index, &plan, &header, length)?;
            row += rows;
            window.take(end);
            if rows == 0 && row < element.count {
                if window.ended {
                    let have = format!("the data ends after {} bytes", window.taken);
                    return Err(too_short(element, row, &have, job));
                }
                // A row that is longer than the window.
                need = 2 * window.data().len().max(WINDOW);
            }
        }
    }
    let trailing_bytes = trailing(&mut window, header.format, job)?;
    let Parts { vertices, faces } = parts;
    finish(Found { header, plan, vertices, faces, trailing_bytes }, job, options)
}

/// The complete rows of `element` from the beginning of `data`, from row number `row` on, and where
/// they end.
fn next_rows(
    data: &[u8],
    ended: bool,
    header: &Header,
    element: &Element,
    row: u64,
    line: &mut u64,
    job: &Job,
) -> Result<(Span, usize)> {
    let wanted = element.count - row;
    if header.format != Format::Ascii {
        return layout::rows(data, 0, element, header.format == Format::Big, row, wanted, job);
    }
    let whole_lines = match ended {
        true => data.len(),
        false => data.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1),
    };
    let mut lines = Lines::new(&data[..whole_lines], *line, job)?;
    let span = lines.take(element, row, wanted);
    let (end, after) = lines.position();
    *line = after;
    Ok((span, end))
}

/// Bytes after the last row; blank lines of text do not count.
fn trailing(window: &mut Window, format: Format, job: &Job) -> Result<u64> {
    let mut trailing = 0u64;
    loop {
        let data = window.data();
        let blank = match (format, trailing) {
            (Format::Ascii, 0) => data.iter().take_while(|b| b.is_ascii_whitespace()).count(),
            _ => 0,
        };
        trailing += (data.len() - blank) as u64;
        window.take(data.len());
        if window.ended {
            return Ok(trailing);
        }
        window.fill(1, job)?;
    }
}

/// What has been read so far.
struct Parts {
    vertices: Vertices,
    faces: Faces,
}

impl Parts {
    /// Adds the rows of `table`, which belong to element number `index`.
    fn read(
        &mut self,
        table: &Table,
        index: usize,
        plan: &Plan,
        header: &Header,
        length: Option<u64>,
    ) -> Result<()> {
        if index == plan.vertex.element {
            self.vertices.reserve(believable(table.element, length));
            self.vertices.append(vertex::read(table, &plan.vertex)?);
        } else if let Some(part) = plan.faces.iter().find(|face| face.element == index) {
            let next = match &self.vertices.positions {
                Positions::F32(positions) => face::read(table, part, positions)?,
                Positions::F64(positions) => face::read(table, part, positions)?,
            };
            if self.faces.triangles.is_empty() && !part.strips {
                self.faces.triangles.reserve_exact(believable(table.element, length));
            }
            self.faces.append(next);
        } else if header.format == Format::Ascii {
            table.blocks(|reader| reader.feed(&mut Unread(table.element)), |()| {})?;
        }
        Ok(())
    }
}

/// Rows of `element` to make room for: what is declared, as far as a file of `length` bytes can
/// hold it.
fn believable(element: &Element, length: Option<u64>) -> usize {
    let row: u64 = element.properties.iter().map(|p| p.shape.least_bytes()).sum();
    let most = length.map_or(UNSEEN, |length| length / row.max(1));
    element.count.min(most) as usize
}

/// The arrays of the plan, empty.
fn none(header: &Header, plan: &Plan, job: &Job) -> Result<Vertices> {
    let element = &header.elements[plan.vertex.element];
    let big = header.format.is_big();
    let table = Table { data: &[], big, span: &Span::default(), element, job: *job };
    vertex::read(&table, &plan.vertex)
}
