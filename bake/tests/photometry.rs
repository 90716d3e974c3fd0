//! Photometric files: what is right is read right, what is broken is named in a line, and nothing panics.

use bake::photometry::{Luminaire, PhotometryError, eulumdat, ies};
use glam::Vec3;
use proptest::prelude::*;

/// A downlight: 100 cd at nadir, 50 at 45°, none at the horizon, the same all around.
const DOWNLIGHT: &str = "IESNA:LM-63-2002\n[TEST] none\n[LUMINAIRE] A downlight\n[MORE] of nobody\nTILT=NONE\n\
    1 1000 1.0 3 1 1 2 0.1 0.1 0\n1.0 1.0 12\n0 45 90\n0\n100 50 0\n";

fn with(from: &str, to: &str) -> Result<Luminaire, PhotometryError> {
    assert!(DOWNLIGHT.contains(from), "{from}");
    ies(DOWNLIGHT.replacen(from, to, 1).as_bytes())
}

fn ldt(symmetry: u32, planes: &[f32], gammas: &[f32], values: &[f32]) -> String {
    let mut lines = vec!["Nobody".to_owned(), "1".to_owned(), symmetry.to_string(), planes.len().to_string()];
    lines.extend(
        ["90", &gammas.len().to_string(), "45", "report", "A lamp", "no 1", "lamp.ldt", "today"]
            .map(str::to_owned),
    );
    lines.extend(
        ["200", "100", "50", "150", "80", "0", "0", "0", "0", "100", "100", "1", "0", "1"].map(str::to_owned),
    );
    lines.extend(["1", "LED", "2000", "3000K", "80", "20"].map(str::to_owned));
    lines.extend((0..10).map(|_| "0.5".to_owned()));
    let numbers = planes.iter().chain(gammas).chain(values).map(f32::to_string);
    lines.extend(numbers);
    lines.join("\r\n")
}

#[test]
fn a_downlight_shines_down() {
    let luminaire = ies(DOWNLIGHT.as_bytes()).unwrap();
    assert_eq!((luminaire.name.as_str(), luminaire.lamp_flux), ("A downlight", Some(1000.0)));
    assert_eq!(luminaire.size, [0.1, 0.1, 0.0]);
    let table = &luminaire.table;
    assert_eq!((table.peak(), table.intensity(Vec3::NEG_Z), table.intensity(Vec3::Z)), (100.0, 100.0, 0.0));
    assert!((table.intensity(Vec3::new(1.0, 0.0, -1.0).normalize()) - 50.0).abs() < 1e-3);
    // Multipliers and ballast are in the intensities, feet in the size; lumens of -1 mean absolute
    // photometry.
    let scaled = with("1000 1.0", "-1 2.0").unwrap();
    assert_eq!((scaled.table.peak(), scaled.lamp_flux), (200.0, None));
    assert_eq!(with("1.0 1.0 12", "0.5 1.0 12").unwrap().table.peak(), 50.0);
    assert!((with("1 2 0.1", "1 1 0.1").unwrap().size[0] - 0.03048).abs() < 1e-6);
}

/// The same distribution written with each symmetry is the same light.
#[test]
fn symmetries_are_written_out() {
    let at = |luminaire: &Luminaire, plane: f32| {
        let (sin, cos) = plane.to_radians().sin_cos();
        luminaire.table.intensity(Vec3::new(cos, sin, -1.0).normalize())
    };
    let file = |horizontals: &str, count: usize, rows: &str| {
        let head = format!("1 1000 1.0 3 {count} 1 2 0.1 0.1 0");
        let text = DOWNLIGHT.replacen("1 1000 1.0 3 1 1 2 0.1 0.1 0", &head, 1);
        ies(text.replacen("\n0\n100 50 0\n", &format!("\n{horizontals}\n{rows}\n"), 1).as_bytes()).unwrap()
    };
    let quadrant = file("0 90", 2, "100 40 0\n100 80 0");
    let half = file("0 90 180", 3, "100 40 0 100 80 0 100 40 0");
    let other_half = file("90 180 270", 3, "100 80 0 100 40 0 100 80 0");
    let whole = file("0 90 180 270 360", 5, "100 40 0 100 80 0 100 40 0 100 80 0 100 40 0");
    let open = file("0 90 180 270", 4, "100 40 0 100 80 0 100 40 0 100 80 0");
    let euro = |symmetry, rows: usize| {
        let row = |i: usize| if i.is_multiple_of(2) { [50.0, 20.0, 0.0] } else { [50.0, 40.0, 0.0] };
        // A file of the planes C270 to C90 starts with one of the bright planes.
        let first = usize::from(symmetry == 3);
        let values: Vec<f32> = (first..first + rows).flat_map(row).collect();
        let text = ldt(symmetry, &[0.0, 90.0, 180.0, 270.0], &[0.0, 45.0, 90.0], &values);
        eulumdat(text.as_bytes()).unwrap()
    };
    let european = [euro(0, 4), euro(2, 3), euro(3, 3), euro(4, 2)];
    for luminaire in [quadrant, half, other_half, open].iter().chain(&european) {
        for plane in [0.0, 30.0, 90.0, 135.0, 200.0, 270.0, 350.0] {
            assert!((at(luminaire, plane) - at(&whole, plane)).abs() < 1e-3, "{plane}");
        }
    }
    assert_eq!((european[0].name.as_str(), european[0].size), ("A lamp", [0.15, 0.08, 0.0]));
    assert_eq!(european[0].lamp_flux, Some(2000.0));
    let round = eulumdat(ldt(1, &[0.0], &[0.0, 90.0], &[50.0, 0.0]).as_bytes()).unwrap();
    assert_eq!(round.table.peak(), 100.0);
}

/// Types A and B: a spot on the axis is one along -Z.
#[test]
fn floodlights_shine_along_their_axis() {
    for kind in [2, 3] {
        let text = format!(
            "IES\nTILT=INCLUDE\n1\n2\n0 90\n1 1\n1 1000 1 3 3 {kind} 2 0 0 0\n1 1 1\n-30 0 30\n-30 0 30\n0 0 0\n0 9 0\n0 0 0\n"
        );
        let luminaire = ies(text.as_bytes()).unwrap();
        assert_eq!(luminaire.table.intensity(Vec3::NEG_Z), 9.0);
        assert_eq!(luminaire.table.intensity(Vec3::new(0.0, 1.0, -1.0).normalize()), 0.0);
    }
}

/// A corpus of broken files: one line each, with the number of the line where there is one.
#[test]
fn broken_files_are_named() {
    let ies_cases = [
        ("TILT=NONE", "", "no TILT= line"),
        ("TILT=NONE", "TILT=lamp.tlt", "line 5: TILT=LAMP.TLT names another file"),
        ("TILT=NONE", "TILT=INCLUDE\n1 2 0 90 1 0.5", "line 6: a tilt factor of 0.5"),
        ("1 1000", "one 1000", "line 6: `one` is no number"),
        ("1.0 3 1 1", "1.0 3.5 1 1", "the number of vertical angles is 3.5"),
        ("1.0 3 1 1", "1.0 3 0 1", "the number of horizontal angles is 0"),
        ("1.0 3 1 1", "1.0 3 1 4", "photometric type 4"),
        ("1.0 3 1 1 2", "1.0 3 1 1 3", "units type 3"),
        ("1.0 3 1 1", "1.0 99999999 1 1", "the number of vertical angles is 100000000"),
        ("1.0 3 1 1", "1.0 9999999 1 1", "9999999 numbers for vertical angles are promised"),
        ("1.0 3 1 1", "1.0 3 2 1", "line 10: 2 x 3 intensities are promised, 2 numbers are left"),
        ("0 45 90", "0 90 45", "line 8: vertical angles go from 90 to 45"),
        ("0 45 90", "0 45 200", "line 8: vertical angles hold 200"),
        ("\n0\n100", "\n5\n100", "line 9: horizontal angles go from 5 to 5"),
        ("100 50 0", "100 -50 0", "intensity 1 must be a finite number"),
        ("100 50 0", "0 0 0", "the intensities sum up to 0"),
        ("100 50 0", "100 50", "1 x 3 intensities are promised, 2 numbers are left"),
        ("100 50 0", "100 1e999 0", "is no number"),
        ("100 50 0", "100 NaN 0", "`NaN` is no number"),
    ];
    for (from, to, expected) in ies_cases {
        let message = with(from, to).unwrap_err().to_string();
        assert!(message.contains(expected), "{to:?}: {message}");
        assert!(!message.contains('\n'));
    }
    assert!(ies(b"").is_err() && eulumdat(b"").is_err() && ies(&[0xff; 64]).is_err());
    assert!(ies(&vec![b' '; bake::photometry::MAX_BYTES + 1]).unwrap_err().to_string().contains("at most"));

    let good = ldt(1, &[0.0], &[0.0, 90.0], &[50.0, 0.0]);
    let line = |n: usize, to: &str| {
        let mut lines: Vec<&str> = good.split("\r\n").collect();
        lines[n - 1] = to;
        eulumdat(lines.join("\n").as_bytes()).unwrap_err().to_string()
    };
    for (n, to, expected) in [
        (3, "7", "line 3: symmetry 7"),
        (4, "0", "line 4: the number of C planes is 0"),
        (6, "1", "line 6: the number of intensities in a plane is 1"),
        (6, "many", "line 6: `many` is no number"),
        (6, "16000000", "16000000 lines of angles are promised"),
        (26, "20", "20 lamp sets of 6 lines"),
        (29, "0", "line 29: the lamps' flux is 0"),
    ] {
        let message = line(n, to);
        assert!(message.contains(expected), "{n}: {message}");
    }
}

proptest! {
    /// Whatever the bytes, reading ends, and what it returns can be used.
    #[test]
    fn bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let _ = ies(&bytes);
        let _ = eulumdat(&bytes);
    }

    /// Files that are almost right: a number changed, a line lost, an end cut off.
    #[test]
    fn almost_right_files_never_panic(
        european in any::<bool>(),
        at in 0usize..400,
        piece in "[-0-9eE., \n\r]{0,6}|NaN|inf|[\\PC]{0,3}",
        length in 0usize..6,
        direction in prop::array::uniform3(-1f32..1.0),
    ) {
        let text = if european { ldt(4, &[0.0, 90.0, 180.0, 270.0], &[0.0, 45.0, 90.0], &[9.0, 8.0, 0.0, 9.0, 7.0, 0.0]) } else { DOWNLIGHT.to_owned() };
        let mut characters: Vec<char> = text.chars().collect();
        let at = at.min(characters.len());
        let end = (at + length).min(characters.len());
        characters.splice(at..end, piece.chars());
        let text: String = characters.into_iter().collect();
        let read = if european { eulumdat(text.as_bytes()) } else { ies(text.as_bytes()) };
        match read {
            Ok(luminaire) => {
                let intensity = luminaire.table.intensity(Vec3::from(direction).normalize_or(Vec3::X));
                prop_assert!(intensity >= 0.0 && intensity <= luminaire.table.peak() * 1.001);
                prop_assert!(luminaire.table.flux() > 0.0);
            }
            Err(error) => prop_assert!(!error.to_string().contains('\n')),
        }
    }
}
