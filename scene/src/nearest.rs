//! The name that a misspelt one was meant to be.

/// The candidate that is fewest edits away from `word`, ties to the first; `None` where even that is no
/// likely slip: more than a third of its letters.
///
/// An edit is a letter too many, too few, another one, or two neighbours swapped (optimal string alignment;
/// Boytsov, "Indexing Methods for Approximate Dictionary Searching", 2011, section 2.2). Case is no edit.
pub fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let word: Vec<char> = word.chars().flat_map(char::to_lowercase).collect();
    let distances = candidates.into_iter().map(|name| {
        let letters: Vec<char> = name.chars().flat_map(char::to_lowercase).collect();
        (edits(&word, &letters), letters.len().max(word.len()), name)
    });
    let (least, length, name) = distances.min_by_key(|&(edits, _, _)| edits)?;
    (least < length && least <= (length / 3).max(1)).then_some(name)
}

/// Edits from `a` to `b`.
fn edits(a: &[char], b: &[char]) -> usize {
    let mut rows = vec![vec![0; b.len() + 1]; a.len() + 1];
    for i in 0..=a.len() {
        for j in 0..=b.len() {
            rows[i][j] = if i == 0 || j == 0 {
                i + j
            } else {
                let other = usize::from(a[i - 1] != b[j - 1]);
                let swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
                let plain = (rows[i - 1][j - 1] + other).min(rows[i - 1][j] + 1).min(rows[i][j - 1] + 1);
                if swapped { plain.min(rows[i - 2][j - 2] + 1) } else { plain }
            };
        }
    }
    rows[a.len()][b.len()]
}

#[cfg(test)]
mod tests {
    use super::nearest;

    #[test]
    fn slips_are_found_and_other_words_are_not() {
        let names = ["tree", "split", "cut", "shared-cut", "cut-cdf", "cut-cdf-vis", "lightcut", "path"];
        let meant = |word| nearest(word, names);
        assert_eq!(meant("lightcutt"), Some("lightcut"));
        assert_eq!(meant("LIGHTCUT"), Some("lightcut"));
        assert_eq!(meant("tere"), Some("tree"));
        assert_eq!(meant("cut_cdf_vis"), Some("cut-cdf-vis"));
        assert_eq!((meant(""), meant("restir"), meant("x")), (None, None, None));
        assert_eq!(nearest("tree", []), None);
    }
}
