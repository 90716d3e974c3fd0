//! Texels beside surfaces, and within solids, take the light of their neighbours, so that filters never mix
//! in black.

/// Fills empty texels from filled ones, `rings` steps far. Each takes the mean of its filled neighbours,
/// those across a corner at half weight. A step sees only what was there before it, so that no order of
/// texels shows. Returns how many were filled.
pub(super) fn dilate(
    [width, height]: [u32; 2],
    channels: usize,
    values: &mut [f32],
    filled: &mut [bool],
    rings: u32,
) -> u64 {
    let (width, height) = (width as usize, height as usize);
    let neighbours = |at: usize| {
        let (x, y) = ((at % width) as isize, (at / width) as isize);
        (-1..=1isize).flat_map(move |dy| (-1..=1isize).map(move |dx| (dx, dy))).filter_map(move |(dx, dy)| {
            let (x, y) = (x + dx, y + dy);
            let inside = x >= 0 && y >= 0 && x < width as isize && y < height as isize && (dx, dy) != (0, 0);
            inside.then(|| (y as usize * width + x as usize, if dx == 0 || dy == 0 { 1.0 } else { 0.5 }))
        })
    };
    let mut border: Vec<usize> =
        (0..width * height).filter(|&at| !filled[at] && neighbours(at).any(|(n, _)| filled[n])).collect();
    let mut total = 0;
    let mut found: Vec<f32> = Vec::new();
    for _ in 0..rings {
        // Look first, then write.
        found.clear();
        for &at in &border {
            let mut weight = 0f32;
            let first = found.len();
            found.resize(first + channels, 0.0);
            for (n, w) in neighbours(at).filter(|&(n, _)| filled[n]) {
                weight += w;
                for (sum, value) in found[first..].iter_mut().zip(&values[n * channels..]) {
                    *sum += w * value;
                }
            }
            found[first..].iter_mut().for_each(|sum| *sum /= weight);
        }
        for (&at, mean) in border.iter().zip(found.chunks_exact(channels)) {
            values[at * channels..(at + 1) * channels].copy_from_slice(mean);
            filled[at] = true;
        }
        total += border.len() as u64;
        let mut next: Vec<usize> =
            border.iter().flat_map(|&at| neighbours(at)).map(|(n, _)| n).filter(|&n| !filled[n]).collect();
        next.sort_unstable();
        next.dedup();
        border = next;
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_grows_by_rings() {
        let (mut values, mut filled) = (vec![0.0; 49], vec![false; 49]);
        values[24] = 3.0;
        filled[24] = true;
        assert_eq!(dilate([7, 7], 1, &mut values, &mut filled, 2), 24);
        assert_eq!(values.iter().filter(|&&v| v == 3.0).count(), 25);
        assert_eq!(values[0], 0.0);
        assert_eq!(dilate([7, 7], 1, &mut values, &mut filled, 9), 24, "it ends when all is filled");
        assert_eq!(dilate([7, 7], 1, &mut [0.0; 49], &mut [false; 49], 9), 0, "nothing has no neighbours");
    }
}
