//! The scanlines of Radiance pictures: run lengths of four channels, of whole pixels (before 1991), or none.

use crate::error::{Error, Result};

/// Lengths of scanlines whose channels may be stored one after the other.
const SPLIT: std::ops::Range<usize> = 8..0x8000;

/// `lines` scanlines of `length` pixels, each three mantissas and an exponent; what follows them is not looked at.
///
/// As Radiance's `freadcolrs` reads them (Ward, "Real Pixels", Graphics Gems II): each line says by its first bytes how it
/// is stored.
pub fn decode(mut body: &[u8], lines: usize, length: usize) -> Result<Vec<[u8; 4]>> {
    // A byte stands for 127 bytes at most in the new encoding. The old one may repeat a pixel for ever, but not a line.
    if length == 0 || lines == 0 || body.len() < lines {
        return Err(Error::input(format!("expected {lines} scanlines of {length} pixels, got {} bytes", body.len())));
    }
    let mut pixels = Vec::new();
    for line in 0..lines {
        let damaged =
            || Error::input(format!("expected {lines} scanlines of {length} pixels; number {line} is damaged"));
        match *body {
            [2, 2, high, low, ..] if high < 128 && SPLIT.contains(&length) => {
                body = &body[4..];
                if usize::from(u16::from_be_bytes([high, low])) != length {
                    return Err(damaged());
                }
                split_line(&mut body, length, &mut pixels).ok_or_else(damaged)?;
            }
            _ => whole_pixels(&mut body, length, &mut pixels).ok_or_else(damaged)?,
        }
    }
    Ok(pixels)
}

/// A scanline whose four channels stand one after the other, in runs of a byte and strings of others.
fn split_line(body: &mut &[u8], length: usize, pixels: &mut Vec<[u8; 4]>) -> Option<()> {
    let first = pixels.len();
    pixels.resize(first + length, [0; 4]);
    for channel in 0..4 {
        let mut at = first;
        while at < pixels.len() {
            let (&code, rest) = body.split_first()?;
            let (run, count) = (code > 128, usize::from(if code > 128 { code - 128 } else { code }));
            let own = pixels.get_mut(at..at + count).filter(|own| !own.is_empty())?;
            let (values, rest) = rest.split_at_checked(if run { 1 } else { count })?;
            for (pixel, value) in own.iter_mut().zip(values.iter().cycle()) {
                pixel[channel] = *value;
            }
            (at, *body) = (at + count, rest);
        }
    }
    Some(())
}

/// A scanline of pixels, in which (1, 1, 1, n) repeats the one before n times; the next such, 256 n times, and so on.
fn whole_pixels(body: &mut &[u8], length: usize, pixels: &mut Vec<[u8; 4]>) -> Option<()> {
    let end = pixels.len() + length;
    let (first, mut shift) = (pixels.len(), 0);
    while pixels.len() < end {
        let (&pixel, rest) = body.split_first_chunk::<4>()?;
        *body = rest;
        if let [1, 1, 1, count] = pixel {
            let count = usize::from(count).checked_shl(shift).filter(|&count| count <= end - pixels.len())?;
            let before = *pixels[first..].last()?;
            pixels.resize(pixels.len() + count, before);
            shift = (shift + 8).min(32);
        } else {
            pixels.push(pixel);
            shift = 0;
        }
    }
    Some(())
}
