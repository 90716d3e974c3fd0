//! Photometric files: what a manufacturer measured of a luminaire, as an emission profile.
//!
//! [`ies`] reads LM-63 (`.ies`), [`eulumdat`] reads EULUMDAT (`.ldt`), both into an [`IntensityTable`].
//! Parsers of our own: the crate that reads both and is kept up is under the AGPL, the other permissive one
//! reads type C alone. They read what is written in practice, not only what the standards allow, but never
//! guess at numbers: what is missing, broken or absurd is a [`PhotometryError`] of one line with the line
//! number in the file.
//!
//! Whatever bytes come in, reading ends without a panic, and holds no more than a fixed multiple of the
//! file's own size.

mod eulumdat_file;
mod ies_file;
mod other_types;
mod text;

use core::fmt;

use crate::IntensityTable;

/// Largest photometric file, bytes: a hundred times the largest that manufacturers publish.
pub const MAX_BYTES: usize = 16 << 20;

/// A photometric file, as far as light is concerned.
#[derive(Clone, Debug, PartialEq)]
pub struct Luminaire {
    /// What the file calls the luminaire; may be empty.
    pub name: String,
    /// Luminous intensities, absolute: the lamps' flux, multipliers and ballast factors are in them.
    pub table: IntensityTable,
    /// Length along X, width along Y and height along Z of the luminous opening, metres; zero: a point in
    /// that direction. Negative sizes of a file, which mean round openings, are given as positive.
    pub size: [f32; 3],
    /// What the file says of its lamps' flux together, lumen; `None` where it gives absolute intensities. For
    /// people: the table's own [`flux`](IntensityTable::flux) is what is emitted.
    pub lamp_flux: Option<f32>,
}

/// Why a photometric file cannot be used.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotometryError {
    /// Line in the file, from 1; 0: the file as a whole.
    pub line: usize,
    /// What is wrong and what would be right, one line.
    pub what: String,
}

impl fmt::Display for PhotometryError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            0 => f.write_str(&self.what),
            line => write!(f, "line {line}: {}", self.what),
        }
    }
}

impl core::error::Error for PhotometryError {}

impl PhotometryError {
    fn at(line: usize, what: impl Into<String>) -> Self {
        Self { line, what: what.into() }
    }
}

/// Reads IES LM-63 of 1986, 1991, 1995, 2002 or 2019, photometry of type A, B or C, from a file's bytes.
///
/// Types A and B are resampled to a table of type C, as dense as the file, but no denser than a degree.
/// `TILT=INCLUDE` is read and applied where its factors are those of a lamp that doesn't tilt (all 1); a file
/// that needs more is refused.
///
/// # Errors
/// [`PhotometryError`] for what is no such file, or one without light.
pub fn ies(bytes: &[u8]) -> Result<Luminaire, PhotometryError> {
    check_size(bytes)?;
    ies_file::read(bytes)
}

/// Reads EULUMDAT from a file's bytes, with any of its symmetries.
///
/// # Errors
/// [`PhotometryError`] for what is no such file, or one without light.
pub fn eulumdat(bytes: &[u8]) -> Result<Luminaire, PhotometryError> {
    check_size(bytes)?;
    eulumdat_file::read(bytes)
}

fn check_size(bytes: &[u8]) -> Result<(), PhotometryError> {
    if bytes.len() > MAX_BYTES {
        return Err(PhotometryError::at(
            0,
            format!(
                "{} bytes: a photometric file has at most {MAX_BYTES}; is it another kind of file?",
                bytes.len()
            ),
        ));
    }
    Ok(())
}
