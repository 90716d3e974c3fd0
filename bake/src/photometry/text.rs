//! Lines and numbers of photometric files, with the line that each stands in.

use super::PhotometryError;

/// The lines of a file; bytes that are no UTF-8 (older files are Latin-1) only matter in names.
pub(super) fn lines(bytes: &[u8]) -> Vec<String> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let text: String = match core::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => bytes.iter().map(|&b| char::from(b)).collect(),
    };
    text.replace("\r\n", "\n").split(['\n', '\r']).map(|line| line.trim().to_owned()).collect()
}

/// A finite number, with a decimal comma if a file has one.
pub(super) fn number(text: &str) -> Option<f32> {
    let plain: f32 = text.parse().or_else(|_| text.replace(',', ".").parse()).ok()?;
    plain.is_finite().then_some(plain)
}

/// Numbers in sequence over any number of lines, parted by blanks or commas.
pub(super) struct Numbers<'a> {
    tokens: Vec<(usize, &'a str)>,
    next: usize,
    last_line: usize,
}

impl<'a> Numbers<'a> {
    /// The numbers of `lines`, of which the first is line `first` of the file (from 1).
    pub(super) fn new(lines: &'a [String], first: usize) -> Self {
        let tokens = lines.iter().enumerate().flat_map(|(i, line)| {
            line.split(|c: char| c.is_whitespace() || c == ',')
                .filter(|token| !token.is_empty())
                .map(move |token| (first + i, token))
        });
        Self { tokens: tokens.collect(), next: 0, last_line: first + lines.len().saturating_sub(1) }
    }

    /// Numbers left.
    pub(super) fn left(&self) -> usize {
        self.tokens.len() - self.next
    }

    /// The line of the next number.
    pub(super) fn line(&self) -> usize {
        self.tokens.get(self.next).map_or(self.last_line, |&(line, _)| line)
    }

    /// The next number; `what` it is, for the message.
    pub(super) fn take(&mut self, what: &str) -> Result<f32, PhotometryError> {
        let Some(&(line, token)) = self.tokens.get(self.next) else {
            return Err(PhotometryError::at(self.last_line, format!("the file ends before {what}")));
        };
        self.next += 1;
        number(token).ok_or_else(|| {
            PhotometryError::at(line, format!("`{}` is no number: {what} belongs here", shown(token)))
        })
    }

    /// `count` numbers; says before anything is read if there aren't so many.
    pub(super) fn take_many(&mut self, count: usize, what: &str) -> Result<Vec<f32>, PhotometryError> {
        if count > self.left() {
            let text =
                format!("{count} numbers for {what} are promised, {} are left in the file", self.left());
            return Err(PhotometryError::at(self.line(), text));
        }
        (0..count).map(|_| self.take(what)).collect()
    }

    /// A whole number of at least `min`.
    pub(super) fn take_count(&mut self, min: usize, what: &str) -> Result<usize, PhotometryError> {
        let line = self.line();
        let value = self.take(what)?;
        count(value, min).ok_or_else(|| {
            PhotometryError::at(line, format!("{what} is {value}: a whole number from {min} belongs here"))
        })
    }
}

/// `value` as a count of at least `min` that a file may hold.
pub(super) fn count(value: f32, min: usize) -> Option<usize> {
    (value.fract() == 0.0 && value >= min as f32 && value <= super::MAX_BYTES as f32)
        .then_some(value as usize)
}

/// A piece of a file in a message: short, and without what a terminal would act on.
pub(super) fn shown(text: &str) -> String {
    text.chars().filter(|c| !c.is_control()).take(24).collect()
}

/// Degrees that must ascend within [`min`, `max`].
pub(super) fn ascending(
    degrees: &[f32],
    (min, max): (f32, f32),
    what: &str,
    line: usize,
) -> Result<(), PhotometryError> {
    if let Some(pair) = degrees.windows(2).find(|pair| pair[0] >= pair[1]) {
        let text = format!("{what} go from {} to {}: they must ascend", pair[0], pair[1]);
        return Err(PhotometryError::at(line, text));
    }
    match degrees.iter().find(|d| !(min..=max).contains(*d)) {
        Some(bad) => {
            Err(PhotometryError::at(line, format!("{what} hold {bad}: they go from {min} to {max} degrees")))
        }
        None => Ok(()),
    }
}
