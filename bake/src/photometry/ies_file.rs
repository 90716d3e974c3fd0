//! IES LM-63: "ANSI/IES LM-63-19, Approved Method: IES Standard File Format for the Electronic Transfer of
//! Photometric Data", and its forerunners since 1986, which differ in the lines above TILT alone.

use crate::IntensityTable;

use super::other_types::{self, Goniometer};
use super::text::{Numbers, ascending, lines, shown};
use super::{Luminaire, PhotometryError};

/// A foot in metres.
const FOOT: f32 = 0.3048;

pub(super) fn read(bytes: &[u8]) -> Result<Luminaire, PhotometryError> {
    let lines = lines(bytes);
    let tilt = lines.iter().position(|line| line.to_ascii_uppercase().starts_with("TILT="));
    let Some(tilt) = tilt else {
        return Err(PhotometryError::at(0, "there is no TILT= line: this is no IES LM-63 file"));
    };
    let name = luminaire_name(&lines[..tilt]);
    let mut numbers = Numbers::new(&lines[tilt + 1..], tilt + 2);
    match lines[tilt][5..].trim().to_ascii_uppercase().as_str() {
        "NONE" => {}
        "INCLUDE" => included_tilt(&mut numbers)?,
        other => {
            let text = format!("TILT={} names another file: write TILT=NONE or TILT=INCLUDE", shown(other));
            return Err(PhotometryError::at(tilt + 1, text));
        }
    }

    // What is to come, and how it counts.
    let lamps = numbers.take("the number of lamps")?;
    let lumens = numbers.take("lumens per lamp")?;
    let multiplier = numbers.take("the candela multiplier")?;
    let verticals = numbers.take_count(1, "the number of vertical angles")?;
    let horizontals = numbers.take_count(1, "the number of horizontal angles")?;
    let line = numbers.line();
    let goniometer = match numbers.take("the photometric type")? {
        1.0 => None,
        2.0 => Some(Goniometer::B),
        3.0 => Some(Goniometer::A),
        other => {
            return Err(PhotometryError::at(
                line,
                format!("photometric type {other}: it is 1 (C), 2 (B) or 3 (A)"),
            ));
        }
    };
    let line = numbers.line();
    let unit = match numbers.take("the units type")? {
        1.0 => FOOT,
        2.0 => 1.0,
        other => {
            return Err(PhotometryError::at(
                line,
                format!("units type {other}: it is 1 (feet) or 2 (metres)"),
            ));
        }
    };
    let [width, length, height] =
        [numbers.take("the width of the opening")?, numbers.take("its length")?, numbers.take("its height")?];
    let ballast = numbers.take("the ballast factor")?;
    let _ballast_lamp_factor_or_reserved = numbers.take("the number after the ballast factor")?;
    let _watts = numbers.take("the input watts")?;

    // Angles and intensities.
    let (vertical_line, vertical) = (numbers.line(), numbers.take_many(verticals, "vertical angles")?);
    let (horizontal_line, horizontal) =
        (numbers.line(), numbers.take_many(horizontals, "horizontal angles")?);
    let line = numbers.line();
    let count = verticals.checked_mul(horizontals).filter(|&n| n <= numbers.left());
    let Some(count) = count else {
        let text = format!(
            "{horizontals} x {verticals} intensities are promised, {} numbers are left in the file",
            numbers.left()
        );
        return Err(PhotometryError::at(line, text));
    };
    let factor = multiplier * ballast;
    let candela: Vec<f32> = numbers.take_many(count, "intensities")?.iter().map(|c| c * factor).collect();

    let grid = Grid { vertical, horizontal, candela };
    let table = match goniometer {
        None => grid.type_c(vertical_line, horizontal_line),
        Some(goniometer) => grid.type_a_or_b(goniometer, vertical_line, horizontal_line),
    }?;
    // Lumens of -1 say that intensities are absolute.
    let lamp_flux = (lumens > 0.0 && lamps > 0.0).then_some(lamps * lumens);
    let size = [length, width, height].map(|s| s.abs() * unit);
    Ok(Luminaire { name, table, size, lamp_flux })
}

/// `[LUMINAIRE]`, or `[LUMCAT]`, or the first line that is none of the format's own.
fn luminaire_name(header: &[String]) -> String {
    let keyword = |key: &str| {
        header.iter().find_map(|line| {
            let rest = line
                .get(..key.len())
                .filter(|start| start.eq_ignore_ascii_case(key))
                .map(|_| &line[key.len()..]);
            rest.map(|rest| rest.trim().to_owned()).filter(|name| !name.is_empty())
        })
    };
    let first = || {
        let plain = |line: &&String| {
            !line.is_empty() && !line.starts_with('[') && !line.to_ascii_uppercase().starts_with("IES")
        };
        header.iter().find(plain).cloned()
    };
    keyword("[LUMINAIRE]").or_else(|| keyword("[LUMCAT]")).or_else(first).unwrap_or_default()
}

/// How a lamp's light depends on the tilt of its luminaire: only files in which it doesn't are read.
fn included_tilt(numbers: &mut Numbers<'_>) -> Result<(), PhotometryError> {
    numbers.take("the lamp-to-luminaire geometry")?;
    let pairs = numbers.take_count(0, "the number of tilt angles")?;
    numbers.take_many(pairs, "tilt angles")?;
    let line = numbers.line();
    let factors = numbers.take_many(pairs, "tilt factors")?;
    match factors.iter().find(|&&f| f != 1.0) {
        Some(factor) => Err(PhotometryError::at(
            line,
            format!(
                "a tilt factor of {factor}: how far the luminaire tilts isn't known here; write TILT=NONE"
            ),
        )),
        None => Ok(()),
    }
}

/// A table as the file has it: degrees, vertical angles fastest.
struct Grid {
    vertical: Vec<f32>,
    horizontal: Vec<f32>,
    candela: Vec<f32>,
}

impl Grid {
    fn type_c(self, vertical_line: usize, horizontal_line: usize) -> Result<IntensityTable, PhotometryError> {
        ascending(&self.vertical, (0.0, 180.0), "vertical angles", vertical_line)?;
        ascending(&self.horizontal, (0.0, 360.0), "horizontal angles", horizontal_line)?;
        let (first, last) = (self.horizontal[0], self.horizontal[self.horizontal.len() - 1]);
        // Degrees all round, and the measured plane that each repeats.
        let own = |i: usize| (self.horizontal[i], i);
        let all = 0..self.horizontal.len();
        let back = || all.clone().rev().skip(1);
        let planes: Vec<(f32, usize)> = match (first, last) {
            (0.0, 0.0) => vec![(0.0, 0)],
            (0.0, 90.0) => {
                let half: Vec<_> =
                    all.clone().map(own).chain(back().map(|i| (180.0 - own(i).0, i))).collect();
                let rest = half.iter().rev().skip(1).map(|&(d, i)| (360.0 - d, i));
                half.iter().copied().chain(rest).collect()
            }
            (0.0, 180.0) => all.clone().map(own).chain(back().map(|i| (360.0 - own(i).0, i))).collect(),
            (90.0, 270.0) => {
                // C and 180 - C are alike; the circle is to start at 0, which mirrors 180.
                let round: Vec<_> =
                    all.clone().map(own).chain(back().map(|i| (540.0 - own(i).0, i))).collect();
                let early =
                    round.iter().filter(|(d, _)| *d >= 360.0 && *d < 450.0).map(|&(d, i)| (d - 360.0, i));
                early.chain(round.iter().filter(|(d, _)| *d <= 360.0).copied()).collect()
            }
            (0.0, 360.0) => all.clone().map(own).collect(),
            // All round but for the plane that closes the circle, which some programs leave out.
            (0.0, last) if last > 180.0 => all.clone().map(own).chain([(360.0, 0)]).collect(),
            _ => {
                let text = format!(
                    "horizontal angles go from {first} to {last}: type C has 0 to 0, 90, 180 or 360, or 90 to 270"
                );
                return Err(PhotometryError::at(horizontal_line, text));
            }
        };
        self.table(&planes, vertical_line)
    }

    /// Types A and B: horizontal angles H and vertical angles V from -90 or 0 to 90; from 0 means symmetric.
    fn type_a_or_b(
        self,
        goniometer: Goniometer,
        vertical_line: usize,
        horizontal_line: usize,
    ) -> Result<IntensityTable, PhotometryError> {
        ascending(&self.vertical, (-90.0, 90.0), "vertical angles", vertical_line)?;
        ascending(&self.horizontal, (-90.0, 90.0), "horizontal angles", horizontal_line)?;
        let mirrored = |angles: &[f32]| -> Vec<(f32, usize)> {
            let own = angles.iter().copied().zip(0..angles.len());
            match angles[0] {
                0.0 => own.clone().skip(1).rev().map(|(d, i)| (-d, i)).chain(own).collect(),
                _ => own.collect(),
            }
        };
        let (h, v) = (mirrored(&self.horizontal), mirrored(&self.vertical));
        let rows = self.vertical.len();
        let candela = h.iter().flat_map(|&(_, i)| v.iter().map(move |&(_, j)| i * rows + j));
        let candela = candela.map(|index| self.candela[index]).collect();
        let angles = |pairs: &[(f32, usize)]| pairs.iter().map(|&(d, _)| d).collect::<Vec<f32>>();
        let grid = other_types::Grid { goniometer, h: angles(&h), v: angles(&v), candela };
        if grid.h.len() < 2 || grid.v.len() < 2 {
            let text = "there is one angle across: at least two make a distribution";
            return Err(PhotometryError::at(vertical_line, text));
        }
        grid.to_type_c(vertical_line)
    }

    fn table(self, planes: &[(f32, usize)], line: usize) -> Result<IntensityTable, PhotometryError> {
        let rows = self.vertical.len();
        let candela =
            planes.iter().flat_map(|&(_, i)| &self.candela[i * rows..(i + 1) * rows]).copied().collect();
        let planes = planes.iter().map(|&(degrees, _)| degrees).collect();
        IntensityTable::new(planes, self.vertical, candela)
            .map_err(|bad| PhotometryError::at(line, bad.to_string()))
    }
}
