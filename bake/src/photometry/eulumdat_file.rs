//! EULUMDAT: Axel Stockmar's format of 1990, which never became a standard; one value a line, intensities in
//! candela per 1000 lumen of the lamps.

use crate::IntensityTable;

use super::text::{ascending, count, lines, number, shown};
use super::{Luminaire, PhotometryError};

/// Which planes a file holds.
#[derive(Clone, Copy, PartialEq)]
enum Symmetry {
    None,
    Rotational,
    /// About the plane C0–C180: planes C0 to C180.
    AboutC0,
    /// About the plane C90–C270: planes C270 to C90.
    AboutC90,
    /// About both: planes C0 to C90.
    Both,
}

/// One value a line, counted.
struct Lines {
    lines: Vec<String>,
    next: usize,
}

impl Lines {
    fn text(&mut self, what: &str) -> Result<&str, PhotometryError> {
        let line = self.next;
        self.next += 1;
        let missing = || PhotometryError::at(self.lines.len(), format!("the file ends before {what}"));
        self.lines.get(line).map(String::as_str).ok_or_else(missing)
    }

    fn skip(&mut self, count: usize) {
        self.next = self.next.saturating_add(count);
    }

    fn number(&mut self, what: &str) -> Result<f32, PhotometryError> {
        let at = self.next + 1;
        let text = self.text(what)?;
        // Notes after the value are common: the value is the first word.
        let word = text.split_whitespace().next().unwrap_or_default();
        let value = number(word);
        value.ok_or_else(|| {
            PhotometryError::at(at, format!("`{}` is no number: {what} belongs here", shown(word)))
        })
    }

    fn count(&mut self, min: usize, what: &str) -> Result<usize, PhotometryError> {
        let at = self.next + 1;
        let value = self.number(what)?;
        count(value, min).ok_or_else(|| {
            PhotometryError::at(at, format!("{what} is {value}: a whole number from {min} belongs here"))
        })
    }

    fn left(&self) -> usize {
        self.lines.len().saturating_sub(self.next)
    }

    fn numbers(&mut self, count: usize, what: &str) -> Result<Vec<f32>, PhotometryError> {
        if count > self.left() {
            let text = format!("{count} lines of {what} are promised, {} are left in the file", self.left());
            return Err(PhotometryError::at(self.lines.len(), text));
        }
        (0..count).map(|_| self.number(what)).collect()
    }
}

pub(super) fn read(bytes: &[u8]) -> Result<Luminaire, PhotometryError> {
    let mut lines = Lines { lines: lines(bytes), next: 0 };
    lines.skip(2); // manufacturer, type
    let symmetry = match lines.count(0, "the symmetry, line 3,")? {
        0 => Symmetry::None,
        1 => Symmetry::Rotational,
        2 => Symmetry::AboutC0,
        3 => Symmetry::AboutC90,
        4 => Symmetry::Both,
        other => return Err(PhotometryError::at(3, format!("symmetry {other}: it goes from 0 to 4"))),
    };
    let planes = lines.count(1, "the number of C planes")?;
    lines.skip(1); // distance of planes: the planes themselves follow
    let gammas = lines.count(2, "the number of intensities in a plane")?;
    lines.skip(2); // distance of angles, report number
    let name = lines.text("the luminaire's name")?.to_owned();
    lines.skip(3); // number, file name, date
    lines.skip(3); // the housing
    let [length, width] = [lines.number("the luminous length")?, lines.number("the luminous width")?];
    let height = lines.number("the luminous height")?;
    lines.skip(3); // heights in other planes
    lines.skip(2); // downward fraction, light output ratio: both are in the intensities
    let conversion = lines.number("the conversion factor for intensities")?;
    lines.skip(1); // tilt while measured
    let sets = lines.count(1, "the number of lamp sets")?;
    let lamp_flux = first_set(&mut lines, sets)?;
    lines.skip(10); // direct ratios

    // Angles and intensities.
    let c_line = lines.next + 1;
    let c = lines.numbers(planes, "C planes")?;
    ascending(&c, (0.0, 360.0), "C planes", c_line)?;
    let gamma_line = lines.next + 1;
    let gamma = lines.numbers(gammas, "angles")?;
    ascending(&gamma, (0.0, 180.0), "angles", gamma_line)?;
    let all_round = all_planes(symmetry, &c, c_line)?;
    let measured = 1 + all_round.iter().map(|&(_, i)| i).max().unwrap_or(0);
    let count = measured.saturating_mul(gammas);
    let line = lines.next + 1;
    let factor = conversion * lamp_flux.map_or(1.0, |flux| flux / 1000.0);
    let candela: Vec<f32> = lines.numbers(count, "intensities")?.iter().map(|v| v * factor).collect();

    let rows = gamma.len();
    let candela = all_round.iter().flat_map(|&(_, i)| &candela[i * rows..(i + 1) * rows]).copied().collect();
    let planes = all_round.iter().map(|&(degrees, _)| degrees).collect();
    let table = IntensityTable::new(planes, gamma, candela)
        .map_err(|bad| PhotometryError::at(line, bad.to_string()))?;
    let size = [length, width, height].map(|millimetres| millimetres.abs() / 1000.0);
    Ok(Luminaire { name, table, size, lamp_flux })
}

/// Flux of the first set of lamps, the one that luminaires are sold with; `None` if the file is absolute (a
/// negative number of lamps).
fn first_set(lines: &mut Lines, sets: usize) -> Result<Option<f32>, PhotometryError> {
    let lamps = lines.number("the number of lamps")?;
    lines.skip(1); // type
    let line = lines.next + 1;
    let flux = lines.number("the lamps' flux")?;
    lines.skip(3); // colour, rendering, watts
    let rest = (sets - 1).checked_mul(6).filter(|&n| n <= lines.left());
    let Some(rest) = rest else {
        return Err(PhotometryError::at(
            line,
            format!("{sets} lamp sets of 6 lines are promised; the file is shorter"),
        ));
    };
    lines.skip(rest);
    if lamps < 0.0 {
        return Ok(None);
    }
    if flux <= 0.0 {
        return Err(PhotometryError::at(
            line,
            format!("the lamps' flux is {flux} lumen: it must be positive"),
        ));
    }
    Ok(Some(flux))
}

/// Degrees all round, ascending from 0 to 360, and the plane in the file that each repeats.
fn all_planes(symmetry: Symmetry, c: &[f32], line: usize) -> Result<Vec<(f32, usize)>, PhotometryError> {
    let quarter = |what: &str, part: usize| {
        if !c.len().is_multiple_of(part) {
            let text = format!(
                "{} C planes with a symmetry {what}: their number must be a multiple of {part}",
                c.len()
            );
            return Err(PhotometryError::at(line, text));
        }
        Ok(c.len() / part)
    };
    let planes: Vec<(f32, usize)> = match symmetry {
        Symmetry::Rotational => return Ok(vec![(0.0, 0)]),
        Symmetry::None => {
            let open = c.iter().copied().zip(0..).take_while(|&(d, _)| d < 360.0);
            open.chain([(360.0, 0)]).collect()
        }
        Symmetry::AboutC0 => {
            let half: Vec<(f32, usize)> =
                c.iter().copied().zip(0..).take(quarter("about C0", 2)? + 1).collect();
            let rest = half.iter().rev().skip(1).map(|&(d, i)| (360.0 - d, i));
            half.iter().copied().chain(rest).collect()
        }
        Symmetry::Both => {
            let quarter: Vec<(f32, usize)> =
                c.iter().copied().zip(0..).take(quarter("about both", 4)? + 1).collect();
            let half: Vec<(f32, usize)> = quarter
                .iter()
                .copied()
                .chain(quarter.iter().rev().skip(1).map(|&(d, i)| (180.0 - d, i)))
                .collect();
            let rest = half.iter().rev().skip(1).map(|&(d, i)| (360.0 - d, i));
            half.iter().copied().chain(rest).collect()
        }
        Symmetry::AboutC90 => {
            // The file starts at C270 and ends at C90; in degrees from -90 to 90.
            let n = quarter("about C90", 4)?;
            let from = |k: usize| c[(3 * n + k) % c.len()];
            let half: Vec<(f32, usize)> =
                (0..=2 * n).map(|k| (if k < n { from(k) - 360.0 } else { from(k) }, k)).collect();
            // C and 180 - C are alike: 0 to 90 is the file's own, 90 to 270 its mirror, 270 to 360 its own
            // again.
            let own = half[n..].iter().copied();
            let mirror = half.iter().rev().skip(1).map(|&(d, i)| (180.0 - d, i));
            let again = half[1..=n].iter().map(|&(d, i)| (360.0 + d, i));
            own.chain(mirror).chain(again).collect()
        }
    };
    let bounds = (planes[0].0, planes[planes.len() - 1].0);
    if bounds != (0.0, 360.0) || planes.windows(2).any(|pair| pair[0].0 >= pair[1].0) {
        let text = "the C planes don't go evenly round from 0 as the symmetry in line 3 asks".to_owned();
        return Err(PhotometryError::at(line, text));
    }
    Ok(planes)
}
