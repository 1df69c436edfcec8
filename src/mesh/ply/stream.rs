//! Files that can only be read from beginning to end, in memory of a fixed size beside the arrays:
//! compressed ones, pipes, and those that shall not be mapped.
//!
//! A thread of its own reads (and unpacks) ahead; a window of the data moves over the file, and the
//! complete rows in it are found and read as those of a whole file are. Only a file whose faces
//! come before its vertices is read to its end first.

use std::io::Read;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use super::block::{Span, too_short};
use super::face::{self, Faces};
use super::header::{self, Element, Format, Header, MAX_HEADER};
use super::job::Job;
use super::lines::Lines;
use super::plan::{self, Plan};
use super::table::Table;
use super::vertex::{self, Vertices};
use super::{Found, ReadOptions, Unread, finish, layout, whole};
use crate::error::{Error, Result};
use crate::mesh::{Mesh, Positions};
use crate::reserve;

/// Bytes that are read at once.
const CHUNK: usize = 1 << 21;
/// Chunks that wait to be taken.
const AHEAD: usize = 2;
/// How often a stream that brings nothing is asked whether to stop.
const PATIENCE: Duration = Duration::from_millis(100);
/// Most rows that are believed in before they have been seen.
const UNSEEN: u64 = 1 << 16;

/// Why a stream ended early.
type Failed<'a> = &'a dyn Fn(&std::io::Error) -> Error;

/// Reads a mesh from a file, of which there are `length` bytes if that is known.
pub(super) fn read(
    mut bytes: Box<dyn Read + Send>,
    length: Option<u64>,
    failed: Failed,
    job: &Job,
    options: ReadOptions,
) -> Result<Mesh> {
    let (sender, chunks) = sync_channel(AHEAD);
    let size = options.window.min(CHUNK);
    // Ends when the receiver is dropped. Nobody waits for it: a pipe may never say anything.
    let thread = std::thread::Builder::new().name("ply".into());
    thread.spawn(move || pump(&mut bytes, size, &sender)).map_err(|error| failed(&error))?;
    Window::new(Chunks::Ahead(chunks), options, failed).mesh(length, job, options)
}

/// The same of bytes that are in memory, packed.
pub(super) fn read_here<'a>(
    bytes: Box<dyn Read + Send + 'a>,
    failed: Failed<'a>,
    job: &Job,
    options: ReadOptions,
) -> Result<Mesh> {
    Window::new(Chunks::Here(bytes), options, failed).mesh(None, job, options)
}

type Chunk = std::io::Result<Vec<u8>>;

/// The next `size` bytes, fewer only at the end.
fn chunk(bytes: &mut dyn Read, size: usize) -> Chunk {
    let mut chunk = Vec::new();
    chunk.try_reserve_exact(size)?;
    bytes.take(size as u64).read_to_end(&mut chunk)?;
    Ok(chunk)
}

/// Sends all of `bytes`, then an empty chunk.
fn pump(bytes: &mut dyn Read, size: usize, sender: &SyncSender<Chunk>) {
    loop {
        let next = chunk(bytes, size);
        let last = next.as_ref().map_or(true, Vec::is_empty);
        if sender.send(next).is_err() || last {
            return;
        }
    }
}

/// Where the window's bytes come from.
enum Chunks<'a> {
    Ahead(Receiver<Chunk>),
    Here(Box<dyn Read + Send + 'a>),
}

impl Chunks<'_> {
    fn next(&mut self, size: usize, job: &Job) -> Result<Chunk> {
        let receiver = match self {
            Self::Ahead(receiver) => receiver,
            Self::Here(bytes) => return job.check().map(|()| chunk(bytes, size)),
        };
        loop {
            job.check()?;
            match receiver.recv_timeout(PATIENCE) {
                Ok(chunk) => return Ok(chunk),
                Err(RecvTimeoutError::Timeout) => {}
                // It sends an empty chunk or an error before it ends.
                Err(RecvTimeoutError::Disconnected) => return Ok(Ok(Vec::new())),
            }
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
    chunks: Chunks<'a>,
    ended: bool,
    failed: Failed<'a>,
    /// Bytes in which rows are looked for at first; longer rows make it grow.
    size: usize,
}

impl<'a> Window<'a> {
    fn new(chunks: Chunks<'a>, options: ReadOptions, failed: Failed<'a>) -> Self {
        let size = options.window.max(1);
        Self { bytes: Vec::new(), at: 0, taken: 0, chunks, ended: false, failed, size }
    }

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
            let chunk = self.chunks.next(self.size.min(CHUNK), job)?;
            let chunk = chunk.map_err(|error| (self.failed)(&error))?;
            self.ended = chunk.is_empty();
            if self.bytes.is_empty() {
                self.bytes = chunk;
            } else {
                job.fits((self.bytes.len() + chunk.len()) as u64)?;
                reserve::growing(&mut self.bytes, chunk.len(), job.name)?;
                self.bytes.extend_from_slice(&chunk);
            }
        }
        Ok(())
    }

    /// Reads everything.
    fn mesh(mut self, length: Option<u64>, job: &Job, options: ReadOptions) -> Result<Mesh> {
        self.fill(1, job)?;
        while !header::is_complete(self.data()) && !self.ended && self.data().len() <= MAX_HEADER {
            self.fill(2 * self.data().len(), job)?;
        }
        let header = header::parse(self.data(), job.name)?;
        let plan = plan::plan(&header, job.name)?;
        if plan.faces.iter().any(|face| face.element < plan.vertex.element) {
            // Faces are checked against the vertices.
            self.fill(usize::MAX, job)?;
            return whole(self.data(), job, options);
        }
        self.take(header.data_start);
        let mut parts = Parts { vertices: none(&header, &plan, job)?, faces: Faces::default() };
        let mut line = header.lines;
        for (index, element) in header.elements.iter().enumerate() {
            let mut row = 0;
            let mut need = self.size;
            while row < element.count {
                self.fill(need, job)?;
                let data = self.data();
                let (span, end) =
                    next_rows(data, self.ended, &header, element, row, &mut line, job)?;
                let rows = span.rows;
                let big = header.format.is_big();
                let table = Table { data, big, span: &span, element, job: *job };
                parts.read(&table, index, &plan, &header, length)?;
                row += rows;
                self.take(end);
                if rows == 0 && row < element.count {
                    if self.ended {
                        let have = format!("the data ends after {} bytes", self.taken);
                        return Err(too_short(element, row, &have, job));
                    }
                    // A row that is longer than the self.
                    need = 2 * self.data().len().max(self.size);
                }
            }
        }
        let trailing_bytes = self.trailing(header.format, job)?;
        let Parts { vertices, faces } = parts;
        finish(Found { header, plan, vertices, faces, trailing_bytes }, job, options)
    }

    /// Bytes after the last row; blank lines of text do not count.
    fn trailing(&mut self, format: Format, job: &Job) -> Result<u64> {
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
            self.fill(1, job)?;
        }
    }
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
            let job = &table.job;
            self.vertices.reserve(believable(table.element, length), job)?;
            self.vertices.append(vertex::read(table, &plan.vertex)?, job)?;
        } else if let Some(part) = plan.faces.iter().find(|face| face.element == index) {
            let next = match &self.vertices.positions {
                Positions::F32(positions) => face::read(table, part, positions)?,
                Positions::F64(positions) => face::read(table, part, positions)?,
            };
            if self.faces.triangles.is_empty() && !part.strips {
                // A triangle has three items of at least a byte.
                let length = length.map(|length| length / 2);
                let count = believable(table.element, length);
                reserve::exact(&mut self.faces.triangles, count, table.job.name)?;
            }
            self.faces.append(next, &table.job)?;
            table.job.fits(self.vertices.bytes().saturating_add(self.faces.bytes()))?;
        } else if header.format == Format::Ascii {
            table.blocks(|reader| reader.feed(&mut Unread(table.element)), Ok)?;
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
