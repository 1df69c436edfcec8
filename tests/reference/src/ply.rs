//! A minimal PLY reader: ascii and binary little endian, any properties, every value as f64.

use std::collections::HashMap;
use std::path::Path;

/// An element kind (`vertex`, `face`): its rows, each with a list per property. A scalar is a list
/// of one.
pub struct Element {
    /// Property names with their value types, in file order.
    pub properties: Vec<(String, String)>,
    /// `rows[r][p]`: the values of property `p` in row `r`.
    pub rows: Vec<Vec<Vec<f64>>>,
}

impl Element {
    /// The column of the first of `names` that the element has.
    pub fn column(&self, names: &[&str]) -> Option<usize> {
        names.iter().find_map(|name| self.properties.iter().position(|(p, _)| p == name))
    }

    /// The scalar columns of all `names`, or none.
    pub fn columns<const N: usize>(&self, names: [&str; N]) -> Option<[usize; N]> {
        let found: Option<Vec<usize>> = names.iter().map(|n| self.column(&[n])).collect();
        found.map(|list| list.try_into().expect("as many as asked"))
    }
}

/// A source of values in either encoding.
struct Values<'a> {
    bytes: &'a [u8],
    ascii: bool,
}

impl Values<'_> {
    fn next(&mut self, kind: &str) -> f64 {
        if self.ascii {
            let start = self.bytes.iter().position(|b| !b.is_ascii_whitespace()).expect("a value");
            let rest = &self.bytes[start..];
            let end = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
            self.bytes = &rest[end..];
            return std::str::from_utf8(&rest[..end]).unwrap().parse().expect("a number");
        }
        match kind {
            "char" | "int8" => f64::from(i8::from_le_bytes(self.take())),
            "uchar" | "uint8" => f64::from(u8::from_le_bytes(self.take())),
            "short" | "int16" => f64::from(i16::from_le_bytes(self.take())),
            "ushort" | "uint16" => f64::from(u16::from_le_bytes(self.take())),
            "int" | "int32" => f64::from(i32::from_le_bytes(self.take())),
            "uint" | "uint32" => f64::from(u32::from_le_bytes(self.take())),
            "float" | "float32" => f64::from(f32::from_le_bytes(self.take())),
            "double" | "float64" => f64::from_le_bytes(self.take()),
            other => panic!("PLY type {other}"),
        }
    }

    fn take<const N: usize>(&mut self) -> [u8; N] {
        let (head, rest) = self.bytes.split_at(N);
        self.bytes = rest;
        head.try_into().expect("N bytes")
    }
}

/// Reads a whole file and returns its elements by name.
pub fn read(path: &Path) -> HashMap<String, Element> {
    const END: &[u8] = b"end_header\n";
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let end = bytes.windows(END.len()).position(|w| w == END).expect("end_header") + END.len();
    let header = std::str::from_utf8(&bytes[..end]).expect("an ascii header");
    let ascii = header.contains("format ascii");
    assert!(ascii || header.contains("format binary_little_endian"), "{header}");
    let mut values = Values { bytes: &bytes[end..], ascii };

    // (element, rows, properties as (name, count type of a list, value type))
    type Property<'a> = (&'a str, Option<&'a str>, &'a str);
    let mut plan: Vec<(&str, usize, Vec<Property>)> = Vec::new();
    for line in header.lines() {
        match line.split_whitespace().collect::<Vec<_>>()[..] {
            ["element", name, rows] => plan.push((name, rows.parse().unwrap(), Vec::new())),
            ["property", "list", count, kind, name] => {
                plan.last_mut().unwrap().2.push((name, Some(count), kind));
            }
            ["property", kind, name] => plan.last_mut().unwrap().2.push((name, None, kind)),
            _ => {}
        }
    }
    let mut elements = HashMap::new();
    for (name, count, properties) in plan {
        let mut cell = |&(_, list, kind): &Property| {
            let length = list.map_or(1, |count| values.next(count) as usize);
            (0..length).map(|_| values.next(kind)).collect()
        };
        let rows = (0..count).map(|_| properties.iter().map(&mut cell).collect()).collect();
        let properties = properties.iter().map(|p| (p.0.to_owned(), p.2.to_owned())).collect();
        elements.insert(name.to_owned(), Element { properties, rows });
    }
    elements
}
