//! Parses and formats sizes, rates and other values in the form that users write and read.

/// Parses a number of bytes: `512MiB`, `8G`, `1.5GB`, `1000000`. All units are powers of 1024, as
/// for memory modules.
pub fn parse_bytes(text: &str) -> Result<u64, String> {
    let expected = || "expected a size such as 8G, 512MiB or 1000000 (bytes)".to_string();
    let split = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let (number, unit) = text.split_at(split);
    let shift = match unit.trim().to_ascii_lowercase().as_str() {
        "" | "b" => 0,
        "k" | "kb" | "kib" => 10,
        "m" | "mb" | "mib" => 20,
        "g" | "gb" | "gib" => 30,
        "t" | "tb" | "tib" => 40,
        _ => return Err(expected()),
    };
    let number: f64 = number.parse().map_err(|_| expected())?;
    let bytes = number * (1u64 << shift) as f64;
    // Probably a forgotten unit.
    if shift == 0 && bytes.fract() != 0.0 {
        return Err(expected());
    }
    if bytes >= 1.0 && bytes < (1u64 << 60) as f64 { Ok(bytes as u64) } else { Err(expected()) }
}

/// Parses a picture size: `1920x1080` -> [1920, 1080]. The check of the scene limits the values.
pub fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let expected = || "expected WIDTHxHEIGHT in pixels, for example 1920x1080".to_string();
    let (width, height) = text.split_once(['x', 'X']).ok_or_else(expected)?;
    let side = |text: &str| text.parse().map_err(|_| expected());
    Ok([side(width)?, side(height)?])
}

/// Parses a frame rate to a fraction: `24`, `24000/1001`, or a rounded television rate such as
/// `23.976`.
pub fn parse_rate(text: &str) -> Result<(i32, u32), String> {
    let expected = || "expected frames per second, for example 24, 24000/1001 or 29.97".to_string();
    let (above, below) = match text.split_once('/') {
        Some((above, below)) => {
            (above.parse().map_err(|_| expected())?, below.parse().map_err(|_| expected())?)
        }
        None => {
            let rate: f64 = text.parse().map_err(|_| expected())?;
            let whole = rate.round();
            // Rates are rounded to two decimals or more: 23.98 is 24 / 1.001.
            let television = (rate - whole / 1.001).abs() < 2.5e-4 * whole;
            match (rate - whole).abs() < 1e-9 {
                _ if !(whole <= 1e6) => return Err(expected()),
                true => (whole as i32, 1),
                false if television => (1000 * whole as i32, 1001),
                false => return Err(expected()),
            }
        }
    };
    if above > 0 && below > 0 { Ok((above, below)) } else { Err(expected()) }
}

/// Parses three angles in degrees: `-90,0,0`.
pub fn parse_angles(text: &str) -> Result<[f64; 3], String> {
    let angles =
        numbers(text).filter(|angles: &[f64; 3]| angles.iter().all(|angle| angle.abs() <= 1e6));
    angles.ok_or_else(|| "expected three angles in degrees, for example -90,0,0".to_string())
}

/// Parses a point in world units: `0,1.5,-2`. Scenes have the same limit of coordinates.
pub fn parse_point(text: &str) -> Result<[f64; 3], String> {
    let point = numbers(text).filter(|point: &[f64; 3]| point.iter().all(|x| x.abs() <= 1e18));
    point.ok_or_else(|| {
        "expected the three coordinates of a point, for example 0,1.5,-2".to_string()
    })
}

fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let parts: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    parts?.try_into().ok()
}

/// Parses two different numbers: `-0.5,2`.
pub fn parse_two(text: &str) -> Result<[f64; 2], String> {
    let range = numbers(text);
    let range =
        range.filter(|range| range[0] != range[1] && range.iter().all(|x| x.abs() <= 1e300));
    range.ok_or_else(|| "expected two different numbers, for example -0.5,2".to_string())
}

/// Parses a margin: `0.08`. It must be below 0.5: two margins of 0.5 would fill the picture.
pub fn parse_margin(text: &str) -> Result<f64, String> {
    let margin = text.parse().ok().filter(|margin| (0.0..0.5).contains(margin));
    margin.ok_or_else(|| "expected a fraction from 0 to below 0.5".to_string())
}

/// Parses the maximum angle in degrees between the two faces of a smooth edge: `40`, `off` (0) or
/// `all` (180).
pub fn parse_smooth(text: &str) -> Result<f64, String> {
    let degrees = match text {
        "off" => Some(0.0),
        "all" => Some(180.0),
        _ => text.parse().ok().filter(|&degrees: &f64| degrees > 0.0 && degrees <= 180.0),
    };
    degrees.ok_or_else(|| "expected degrees above 0 and up to 180, `off` or `all`".to_string())
}

/// Parses a range: `0..24`. The end is excluded.
pub fn parse_range(text: &str) -> Result<std::ops::Range<u64>, String> {
    let expected = || "expected A..B with A < B, for example 0..24".to_string();
    let (from, to) = text.split_once("..").ok_or_else(expected)?;
    let number = |text: &str| text.parse().map_err(|_| expected());
    let range = number(from)?..number(to)?;
    if range.is_empty() { Err(expected()) } else { Ok(range) }
}

/// Formats a number of bytes: `1.5 GiB`.
pub fn bytes(count: u64) -> String {
    in_units(count, |tenths| tenths)
}

/// Formats a number of bytes, rounded up. So the text is sufficient as a value of `--max-memory`.
pub fn bytes_rounded_up(count: u64) -> String {
    in_units(count, f64::ceil)
}

fn in_units(count: u64, round_tenths: fn(f64) -> f64) -> String {
    let units = ["B", "KiB", "MiB", "GiB", "TiB"];
    let mut value = count as f64;
    let mut unit = 0;
    // 1023.96 KiB would be rounded to 1024.0 KiB.
    let full = |value: f64, unit: usize| match unit {
        0 => value >= 1024.0,
        _ => round_tenths(value * 10.0).round() >= 10240.0,
    };
    while unit + 1 < units.len() && full(value, unit) {
        value /= 1024.0;
        unit += 1;
    }
    match unit {
        0 => format!("{count} B"),
        _ => format!("{:.1} {}", round_tenths(value * 10.0) / 10.0, units[unit]),
    }
}

/// Formats a count with separators: `1,234,567`.
pub fn count(count: u64) -> String {
    indicatif::HumanCount(count).to_string()
}

/// Formats ascending numbers as ranges: `0-3, 7, 9-12`. Beyond 20 ranges it counts the others.
pub fn ranges(numbers: &[u32]) -> String {
    const MAX_RANGES: usize = 20;
    let mut ranges = numbers.chunk_by(|a, b| a.checked_add(1) == Some(*b));
    let text = |range: &[u32]| match range {
        [first, .., last] => format!("{first}-{last}"),
        _ => range.first().map_or(String::new(), u32::to_string),
    };
    let shown: Vec<String> = ranges.by_ref().take(MAX_RANGES).map(text).collect();
    let rest: usize = ranges.map(<[u32]>::len).sum();
    if rest == 0 { shown.join(", ") } else { format!("{} and {rest} more", shown.join(", ")) }
}

/// Formats a count with its noun: `1 thread`, `2,000 threads`.
pub fn plural(number: usize, one: &str) -> String {
    counted(number as u64, [one, &format!("{one}s")])
}

/// Formats a count of `one` thing or `many`: `1 colour is white`, `2,000 colours are white`.
pub fn counted(number: u64, [one, many]: [&str; 2]) -> String {
    format!("{} {}", count(number), if number == 1 { one } else { many })
}

/// Returns the text with a capital first letter.
pub fn capital(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or(String::new(), |first| first.to_uppercase().chain(chars).collect())
}

/// Formats a time in seconds: `0.82 s`, `3:07`, `2:03:07`.
pub fn duration(seconds: f64) -> String {
    let whole = seconds.max(0.0).round() as u64;
    match whole {
        0..60 => format!("{:.2} s", seconds.max(0.0)),
        60..3600 => format!("{}:{:02}", whole / 60, whole % 60),
        _ => format!("{}:{:02}:{:02}", whole / 3600, whole / 60 % 60, whole % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_formatted_as_ranges() {
        assert_eq!(ranges(&[]), "");
        assert_eq!(ranges(&[0, 1, 2, 7, 9, 10]), "0-2, 7, 9-10");
        let even: Vec<u32> = (0..50).map(|n| 2 * n).collect();
        assert!(ranges(&even).ends_with("36, 38 and 30 more"), "{}", ranges(&even));
    }

    #[test]
    fn counts_agree_with_their_nouns() {
        assert_eq!([0, 1, 2000].map(|n| plural(n, "ray")), ["0 rays", "1 ray", "2,000 rays"]);
        let are = |n| counted(n, ["colour is", "colours are"]);
        assert_eq!([are(1), are(2)], ["1 colour is", "2 colours are"]);
    }

    #[test]
    fn frame_rates_are_parsed() {
        assert_eq!(parse_rate("24"), Ok((24, 1)));
        assert_eq!(parse_rate("24000/1001"), Ok((24000, 1001)));
        assert_eq!(parse_rate("23.976"), Ok((24000, 1001)));
        assert_eq!(parse_rate("29.97"), Ok((30000, 1001)));
        assert_eq!(parse_rate("59.94"), Ok((60000, 1001)));
        assert_eq!(parse_rate("23.98"), Ok((24000, 1001)));
        assert_eq!(parse_rate("119.88"), Ok((120_000, 1001)));
        let bad = ["", "0", "-24", "24/0", "24.5", "nan", "inf", "1/-2", "fast"];
        for bad in bad.iter().chain(&["1.004", "3.001", "23.99", "3000000000", "1e300"]) {
            assert!(parse_rate(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn sizes_angles_points_and_ranges_are_parsed() {
        assert_eq!(parse_bytes("8G"), Ok(8 << 30));
        assert_eq!(parse_bytes("512MiB"), Ok(512 << 20));
        assert_eq!(parse_bytes("1.5k"), Ok(1536));
        assert_eq!(parse_bytes("77"), Ok(77));
        for bad in ["", "G", "-1", "0", "8X", "1e9", "99999999T", "nan", "1..2G", "1.5"] {
            assert!(parse_bytes(bad).is_err(), "{bad}");
        }
        assert_eq!(parse_size("640x480"), Ok([640, 480]));
        assert_eq!(parse_angles("-90, 0,1e1"), Ok([-90.0, 0.0, 10.0]));
        for bad in ["", "1,2", "1,2,3,4", "a,b,c", "nan,0,0", "1e9,0,0"] {
            assert!(parse_angles(bad).is_err(), "{bad}");
        }
        assert_eq!(parse_point("2600000.5, 0,-1e18"), Ok([2_600_000.5, 0.0, -1e18]));
        for bad in ["", "1,2", "1,2,3,4", "a,b,c", "nan,0,0", "inf,0,0", "1e19,0,0"] {
            assert!(parse_point(bad).is_err_and(|text| text.contains("coordinates")), "{bad}");
        }
        assert_eq!(parse_two("2, -0.5"), Ok([2.0, -0.5]));
        for bad in ["", "1", "1,1", "1,2,3", "nan,1", "1,nan", "inf,0", "1e301,0"] {
            assert!(parse_two(bad).is_err(), "{bad}");
        }
        assert_eq!(parse_range("3..7"), Ok(3..7));
        for bad in ["", "3", "3..3", "7..3", "..3", "3..", "3..=7", "-1..3"] {
            assert!(parse_range(bad).is_err(), "{bad}");
        }
        assert_eq!(parse_margin("0"), Ok(0.0));
        assert_eq!(
            (parse_smooth("off"), parse_smooth("all"), parse_smooth("37.5")),
            (Ok(0.0), Ok(180.0), Ok(37.5))
        );
        assert!(
            ["0", "181", "-1", "NaN", "inf", "on", ""].iter().all(|bad| parse_smooth(bad).is_err())
        );
        for bad in ["0.5", "-0.1", "nan", "x"] {
            assert!(parse_margin(bad).is_err(), "{bad}");
        }
        for bad in ["640", "x", "640x", "-1x2", "640x480x3", "99999999999x1"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn bytes_counts_and_durations_are_formatted() {
        assert_eq!(bytes(1023), "1023 B");
        assert_eq!(bytes(1536), "1.5 KiB");
        assert_eq!(bytes(1537), "1.5 KiB");
        assert_eq!(bytes_rounded_up(1537), "1.6 KiB");
        assert_eq!(bytes_rounded_up(1536), "1.5 KiB");
        assert_eq!(bytes((1 << 20) - 1), "1.0 MiB");
        assert_eq!(bytes_rounded_up((1 << 20) - 1), "1.0 MiB");
        assert_eq!(bytes_rounded_up((1 << 20) - 110), "1023.9 KiB");
        assert_eq!(bytes(u64::MAX), "16777216.0 TiB");
        assert_eq!(count(1), "1");
        assert_eq!(count(1234), "1,234");
        assert_eq!(count(123_456_789), "123,456,789");
        assert_eq!(duration(0.823), "0.82 s");
        assert_eq!(duration(187.0), "3:07");
        assert_eq!(duration(7387.0), "2:03:07");
    }
}
