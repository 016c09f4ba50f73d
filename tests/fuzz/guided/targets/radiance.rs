//! Any bytes for the scanlines of a Radiance picture: the first three say how many, and how long they are.
#![no_main]

use _core::light::radiance::decode;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    if let [lines, high, low, body @ ..] = data {
        let (lines, length) = (usize::from(*lines), usize::from(u16::from_be_bytes([*high, *low])));
        if let Ok(pixels) = decode(body, lines, length) {
            assert_eq!(pixels.len(), lines * length);
        }
    }
});
