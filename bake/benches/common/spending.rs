//! What an edit changes in the lights of a bake, and how few of them would do: the limits of any order of
//! updates.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use bake::{Contribution, Polygon, Shape, VirtualLight};
use glam::Vec3;

use crate::common::{Host, View};

/// What became of a light that is named by its seed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Fate {
    /// Only what it shines on, or past, may have changed.
    Shadows,
    /// The same shape with another flux.
    Scaled,
    /// Both.
    ScaledAndShadows,
    /// A patch with another outline, or with shadow rays to other places.
    Patch,
    /// A disk somewhere else.
    Disk,
    /// A piece of a lamp elsewhere, or another kind of light.
    Other,
    /// There was none, or is none.
    OneSided,
}

struct Slot {
    fate: Fate,
    change: Vec<f32>,
    /// Its change without the noise of where shadow rays end.
    expected: Vec<f32>,
}

impl Slot {
    /// Passes that it takes.
    fn cost(&self) -> f64 {
        match self.fate {
            Fate::OneSided | Fate::Scaled | Fate::Shadows | Fate::ScaledAndShadows => 1.0,
            Fate::Patch | Fate::Disk | Fate::Other => 2.0,
        }
    }
}

fn fate(old: &Contribution, new: &Contribution) -> Fate {
    let (scaled, moved) = (old.light.flux != new.light.flux, old.version != new.version);
    match (&old.light.shape, &new.light.shape) {
        (a, b) if a == b && scaled && moved => Fate::ScaledAndShadows,
        (a, b) if a == b && scaled => Fate::Scaled,
        (a, b) if a == b => Fate::Shadows,
        (Shape::Patch { .. }, Shape::Patch { .. }) => Fate::Patch,
        (Shape::Disk { .. }, Shape::Disk { .. }) => Fate::Disk,
        _ => Fate::Other,
    }
}

/// Other shadow rays that the mean is taken over.
const ROUNDS: u32 = 8;

/// Lines for people: energies of changes by fate, and what the best orders would take.
pub(crate) fn spending(before: &[Contribution], after: &[Contribution], host: &Host, view: &View) -> String {
    let by_seed = |all: &[Contribution]| -> BTreeMap<u32, Contribution> {
        all.iter().map(|contribution| (contribution.light.seed, contribution.clone())).collect()
    };
    let (old, new) = (by_seed(before), by_seed(after));
    let mut slots = Vec::new();
    for seed in old.keys().chain(new.keys().filter(|seed| !old.contains_key(seed))) {
        let pair = (old.get(seed), new.get(seed));
        let fate = match pair {
            (Some(old), Some(new)) if old == new => continue,
            (Some(old), Some(new)) => fate(old, new),
            _ => Fate::OneSided,
        };
        let change = |shift: u32| -> Vec<f32> {
            let mut own =
                View { points: view.points.clone(), sums: vec![0.0; view.points.len()], accumulations: 0 };
            for (contribution, sign) in [(pair.0, -1.0), (pair.1, 1.0)] {
                if let Some(contribution) = contribution {
                    let light = VirtualLight { seed: seed.wrapping_add(shift), ..contribution.light.clone() };
                    own.add(host, &Contribution { light, ..contribution.clone() }, sign);
                }
            }
            own.sums.iter().map(|&sum| sum as f32).collect()
        };
        let first = change(0);
        let mut expected = vec![0f32; first.len()];
        for round in 1..=ROUNDS {
            add(&mut expected, &change(round), 1.0 / ROUNDS as f32);
        }
        slots.push(Slot { fate, change: first, expected });
    }
    let mut out = String::new();
    let mut total = vec![0f32; view.points.len()];
    slots.iter().for_each(|slot| add(&mut total, &slot.change, 1.0));
    let initial = norm(&total);
    let mut fates: BTreeMap<Fate, (usize, Vec<f32>, f64, f64)> = BTreeMap::new();
    for slot in &slots {
        let entry = fates.entry(slot.fate).or_insert_with(|| (0, vec![0.0; total.len()], 0.0, 0.0));
        entry.0 += 1;
        add(&mut entry.1, &slot.change, 1.0);
        entry.2 += norm(&slot.change).powi(2);
        entry.3 += norm(&slot.expected).powi(2);
    }
    for (fate, (count, sum, energy, expected)) in &fates {
        writeln!(
            out,
            "    {:<17}{count:>6} lights, together {:>6.3}, root of squares {:>6.3}, without noise {:>6.3}",
            format!("{fate:?}"),
            norm(sum) / initial,
            energy.sqrt() / initial,
            expected.sqrt() / initial
        )
        .unwrap();
    }
    let (greedy, largest) = (greedy(&slots, &total), largest_first(&slots, &total));
    writeln!(out, "    if all changes were known: greedy {greedy}, largest first {largest}").unwrap();
    out
}

/// Accumulations to a tenth of the error when each time that change is made that takes most of what is left.
fn greedy(slots: &[Slot], total: &[f32]) -> f64 {
    let (mut left, mut open): (Vec<f32>, Vec<&Slot>) = (total.to_vec(), slots.iter().collect());
    let (end, mut cost) = (0.1 * norm(total), 0.0);
    let squares: BTreeMap<*const Slot, f64> =
        slots.iter().map(|s| (core::ptr::from_ref(s), norm(&s.change).powi(2))).collect();
    while norm(&left) > end && !open.is_empty() {
        let gain = |slot: &Slot| {
            (2.0 * dot(&left, &slot.change) - squares[&core::ptr::from_ref(slot)]) / slot.cost()
        };
        let best = open
            .iter()
            .enumerate()
            .map(|(i, slot)| (gain(slot), i))
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(0, |(_, i)| i);
        let slot = open.swap_remove(best);
        add(&mut left, &slot.change, -1.0);
        cost += slot.cost();
    }
    cost
}

/// The same in the order of how much each change is seen for itself.
fn largest_first(slots: &[Slot], total: &[f32]) -> f64 {
    let mut order: Vec<(f64, &Slot)> =
        slots.iter().map(|slot| (norm(&slot.expected) / slot.cost(), slot)).collect();
    order.sort_by(|a, b| b.0.total_cmp(&a.0));
    let (mut left, end, mut cost, mut to) = (total.to_vec(), 0.1 * norm(total), 0.0, 0.0);
    for (_, slot) in order {
        add(&mut left, &slot.change, -1.0);
        cost += slot.cost();
        if norm(&left) > end {
            to = cost;
        }
    }
    to
}

fn add(to: &mut [f32], other: &[f32], scale: f32) {
    to.iter_mut().zip(other).for_each(|(to, other)| *to += scale * other);
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>().into()
}

fn norm(a: &[f32]) -> f64 {
    dot(a, a).sqrt()
}

/// What merging across cells (Luksch et al. 2019, section 4.1, "Border Handling") might save in one bake:
/// disks that lie in the plane of a neighbouring patch, and patches that continue in the next cell.
pub(crate) fn borders(lights: &[Contribution]) -> String {
    let patches: Vec<(&Polygon, f64)> = lights
        .iter()
        .filter_map(|Contribution { light, .. }| match &light.shape {
            Shape::Patch { polygon, .. } => Some((polygon, f64::from(light.flux.element_sum()))),
            _ => None,
        })
        .collect();
    let is_in_plane = |polygon: &Polygon, normal: Vec3, at: Vec3| {
        let height = polygon.normal().dot(at - polygon.centroid());
        polygon.normal().dot(normal) > 0.9998 && height.abs() < 0.02 * polygon.radius()
    };
    let (mut disks, mut joined, mut flux_of_disks, mut flux_joined) = (0, 0, 0.0, 0.0);
    for Contribution { light, .. } in lights {
        let Shape::Disk { position, normal, radius } = light.shape else { continue };
        let flux = f64::from(light.flux.element_sum());
        disks += 1;
        flux_of_disks += flux;
        // A disk's radius is at least an eighth of its cell's side.
        let near =
            |polygon: &Polygon| position.distance(polygon.centroid()) < polygon.radius() + 8.0 * radius;
        if patches.iter().any(|(polygon, _)| is_in_plane(polygon, normal, position) && near(polygon)) {
            joined += 1;
            flux_joined += flux;
        }
    }
    // Coplanar patches that touch are one.
    let mut group: Vec<usize> = (0..patches.len()).collect();
    for (i, (a, _)) in patches.iter().enumerate() {
        for (j, (b, _)) in patches.iter().enumerate().take(i) {
            let touch = a.centroid().distance(b.centroid()) < 1.05 * (a.radius() + b.radius());
            let (own, other) = (group[i], group[j]);
            if own != other && touch && is_in_plane(a, b.normal(), b.centroid()) {
                group.iter_mut().filter(|g| **g == own).for_each(|g| *g = other);
            }
        }
    }
    let flux_of_patches: f64 = patches.iter().map(|patch| patch.1).sum();
    let groups = group.iter().collect::<std::collections::BTreeSet<_>>().len();
    format!(
        "    {} patches in {groups} planes of touching ones; {disks} disks, {joined} of them beside a patch of their plane, \
         {:.1} % and {:.1} % of the flux of clusters\n",
        patches.len(),
        100.0 * flux_of_disks / (flux_of_patches + flux_of_disks),
        100.0 * flux_joined / (flux_of_patches + flux_of_disks),
    )
}
