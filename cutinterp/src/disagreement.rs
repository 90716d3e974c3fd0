//! Where light changes faster than the records foresaw.

use crate::{Site, WeightParams};

/// Which records disagree with a neighbour about how bright it is: where the light changes faster than the
/// distance to the geometry makes one expect, as at the edge of a shadow. The paper's authors name this as
/// future work.
///
/// `neighbours` lists the ids of the records that may reach record `i`; a pair disagrees when its
/// brightnesses differ by more than `spread` of the larger. A second round of placement with smaller radii
/// for these ([`disagreement_radius`]) brings more records there.
///
/// # Panics
/// If there is not one brightness per record, or a neighbour is no record.
pub fn disagreeing<'a>(
    params: &WeightParams,
    sites: &[Site],
    brightness: &[f32],
    spread: f32,
    neighbours: impl Fn(usize) -> &'a [u32],
) -> Vec<bool> {
    assert_eq!(sites.len(), brightness.len(), "one brightness per record");
    let mut marked = vec![false; sites.len()];
    for (i, site) in sites.iter().enumerate() {
        for &j in neighbours(i) {
            let other = j as usize;
            let (a, b) = (brightness[i], brightness[other]);
            let disagree = (a - b).abs() > spread * a.max(b);
            if other != i
                && disagree
                && params.weight(site.position, site.normal, &sites[other]) > params.epsilon
            {
                marked[i] = true;
                marked[other] = true;
            }
        }
    }
    marked
}

/// Half the radius of a record that disagrees with its neighbours, but not less than the least that its
/// footprint allows.
pub fn disagreement_radius(params: &WeightParams, radius: f32, footprint: f32) -> f32 {
    (0.5 * radius).max(params.radius(0.0, footprint))
}
