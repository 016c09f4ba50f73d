//! Radiance's scanlines: what three plain writers wrote is read, and what is cut or runs over its line is refused.

use _core::light::radiance::decode;
use proptest::prelude::*;

/// A picture of so many lines, with runs in it; no pixel is (1, 1, 1, n), which means a run.
fn pictures() -> impl Strategy<Value = (usize, Vec<[u8; 4]>)> {
    let pixel = prop::array::uniform4(2u8..6);
    (1usize..5, 8usize..300).prop_flat_map(move |(lines, length)| {
        prop::collection::vec((pixel.clone(), 1usize..200), lines * length).prop_map(move |runs| {
            let pixels = runs.iter().flat_map(|&(pixel, run)| std::iter::repeat_n(pixel, run));
            (length, pixels.take(lines * length).collect())
        })
    })
}

/// As `fwritecolrs` writes since 1991: channel after channel, in runs of more than three and strings of others.
fn split(length: usize, pixels: &[[u8; 4]]) -> Vec<u8> {
    let mut body = Vec::new();
    for line in pixels.chunks(length) {
        body.extend([2, 2, (length >> 8) as u8, length as u8]);
        for channel in 0..4 {
            let values: Vec<u8> = line.iter().map(|pixel| pixel[channel]).collect();
            let mut at = 0;
            while at < length {
                let run = values[at..].iter().take(127).take_while(|&&value| value == values[at]).count();
                let count = if run > 3 { run } else { run.min(length - at).min(128) };
                if run > 3 {
                    body.extend([128 + run as u8, values[at]]);
                } else {
                    body.push(count as u8);
                    body.extend(&values[at..at + count]);
                }
                at += count;
            }
        }
    }
    body
}

/// As before: (1, 1, 1, n) repeats a pixel, and one behind another counts 256 times as much.
fn runs(length: usize, pixels: &[[u8; 4]]) -> Vec<u8> {
    let mut body = Vec::new();
    for line in pixels.chunks(length) {
        let mut at = 0;
        while at < length {
            let run = line[at..].iter().take_while(|&pixel| *pixel == line[at]).count();
            body.extend(line[at]);
            let more = run - 1;
            if more > 0 {
                body.extend([1, 1, 1, (more & 255) as u8]);
            }
            if more > 255 {
                body.extend([1, 1, 1, (more >> 8) as u8]);
            }
            at += run;
        }
    }
    body
}

proptest! {
    #[test]
    fn every_writer_is_read((length, pixels) in pictures(), cut in 0.0f64..1.0) {
        let lines = pixels.len() / length;
        // Pixels that begin like a line of channels would be taken for one.
        let flat: Vec<[u8; 4]> = pixels.iter().map(|pixel| [pixel[0] + 1, pixel[1], pixel[2], pixel[3]]).collect();
        for (body, expected) in [
            (split(length, &pixels), &pixels),
            (runs(length, &flat), &flat),
            (flat.as_flattened().to_vec(), &flat),
        ] {
            prop_assert_eq!(&decode(&body, lines, length).unwrap(), expected);
            let shorter = (cut * body.len() as f64) as usize;
            prop_assert!(decode(&body[..shorter], lines, length).is_err());
        }
    }

    #[test]
    fn noise_is_never_more_than_was_asked_for(body in prop::collection::vec(any::<u8>(), 0..2000), length in 1usize..400) {
        if let Ok(pixels) = decode(&body, 3, length) {
            prop_assert_eq!(pixels.len(), 3 * length);
        }
    }
}

#[test]
fn lines_do_not_share_runs() {
    // A line that begins with a run has no pixel to repeat; one that runs over its end is damaged.
    assert!(decode(&[9, 9, 9, 9, 1, 1, 1, 1, 1, 1, 1, 2], 2, 2).is_err());
    assert!(decode(&[9, 9, 9, 9, 1, 1, 1, 4], 2, 2).is_err());
    assert!(decode(&[2, 2, 0, 9], 1, 8).is_err());
    assert!(decode(&[], 1 << 40, 1 << 40).is_err());
}
