//! What any tree, bound or sampler must do, as functions that say what is wrong: the contracts of this
//! crate's traits, in code.
//!
//! Each returns `Err` with a sentence for a person to read, or `Ok` with what was measured. An implementation
//! calls those that concern it from its own tests, in one line each.

pub mod fixtures;

use crate::oracle::{Distribution, sum};
use crate::rng::{Decisions, Random};
use crate::{
    BatchLightSampler, BatchRayQueries, LightBounds, LightHierarchy, LightId, LightSampler, NodeBound,
    NodeId, Ray, RayHit, RayQueries, SampleRequest, Segment, WeightedLight,
};

/// What is wrong, in words.
pub type Failure = String;

/// A tree over lights: children split their parent's slots left to right, parents' bounds contain their
/// children's, every slot holds a light of its own, and the way from light to slot leads back.
///
/// Cones may be rounded outwards or inwards by at most 1e-4 rad; intensities by 1e-4 of their sum.
pub fn check_hierarchy(tree: &impl LightHierarchy) -> Result<(), Failure> {
    let Some(root) = tree.root() else { return Ok(()) };
    let mut open = vec![root];
    let mut seen = std::collections::HashSet::new();
    while let Some(node) = open.pop() {
        if tree.node_index(node) >= tree.node_count() {
            return Err(format!(
                "node {} has index {} of {}",
                node.0,
                tree.node_index(node),
                tree.node_count()
            ));
        }
        let (bounds, items) = (tree.bounds(node), tree.items(node));
        if items.is_empty() {
            return Err(format!("node {} has no items", node.0));
        }
        let children: Vec<_> = tree.children(node).map(NodeId).collect();
        if children.is_empty() {
            for slot in items {
                let light = tree.light_at(slot);
                if tree.slot_of(light) != Some(slot) {
                    return Err(format!(
                        "slot {slot} holds light {}, whose slot is {:?}",
                        light.0,
                        tree.slot_of(light)
                    ));
                }
                if !seen.insert(light) {
                    return Err(format!("light {} is in two slots", light.0));
                }
            }
            continue;
        }
        let mut next = items.start;
        for &child in &children {
            let below = tree.items(child);
            if below.start != next {
                return Err(format!(
                    "child {} of {} starts at slot {}, not {next}",
                    child.0, node.0, below.start
                ));
            }
            next = below.end;
            if !bounds.contains(&tree.bounds(child), 1e-4) {
                return Err(format!("node {} does not contain its child {}", node.0, child.0));
            }
        }
        if next != items.end {
            return Err(format!("children of {} end at slot {next}, not {}", node.0, items.end));
        }
        let below = sum(children.iter().map(|&child| f64::from(tree.bounds(child).intensity)));
        if (f64::from(bounds.intensity) - below).abs() > 1e-4 * below {
            return Err(format!("node {} has intensity {}, its children {below}", node.0, bounds.intensity));
        }
        open.extend(children.iter().rev());
    }
    Ok(())
}

/// A bound of one group of emitters: not negative, not NaN, and not below a `contribution` of them that is
/// known; `slack` is the relative error of that.
pub fn check_bound<R: ?Sized>(
    bound: &impl NodeBound<R>,
    emitters: &LightBounds,
    receiver: &R,
    contribution: f64,
    slack: f64,
) -> Result<(), Failure> {
    let upper = bound.bound(emitters, receiver).upper;
    if upper.is_nan() || upper < 0.0 {
        return Err(format!("a bound of {upper}"));
    }
    if contribution > upper * (1.0 + slack) {
        return Err(format!("a contribution of {contribution:e} above its bound of {upper:e}"));
    }
    Ok(())
}

/// How a sampler is put to the test.
#[derive(Clone, Copy, Debug)]
pub struct SamplerCheck {
    /// Number of lights: ids `0..lights`.
    pub lights: u32,
    /// Samples to draw, at least 1000.
    pub samples: u32,
    /// Seed of all of them.
    pub seed: u32,
    /// Probability with which a right sampler fails the chi² test, e.g. 1e-4: a fixed seed makes it pass or
    /// fail for ever.
    pub significance: f64,
}

/// What a sampler did in [`check_sampler`].
#[derive(Clone, Copy, Debug)]
pub struct SamplerReport {
    /// Samples in which nothing was drawn.
    pub nothing: u32,
    /// Probability of a chi² as large as the one found, or larger, if the sampler is right.
    pub p_value: f64,
    /// The estimate of the sum of contributions.
    pub mean: f64,
    /// Its standard error, from the exact variance.
    pub standard_error: f64,
}

/// A sampler and one receiver:
/// - every sample reports its `pmf`, and `pmf` says the same;
/// - the probabilities sum to at most 1 (to 1e-12);
/// - every light that contributes can be drawn, and the mean of `contribution / pmf` is their sum within 4
///   standard errors;
/// - how often each light is drawn passes a chi² test, and so does how often none is.
pub fn check_sampler<R: ?Sized>(
    sampler: &impl LightSampler<R>,
    receiver: &R,
    contribution: impl Fn(LightId) -> f64,
    check: &SamplerCheck,
) -> Result<SamplerReport, Failure> {
    let exact = Distribution::of(sampler, receiver, check.lights);
    let total = exact.total();
    if total.is_nan() || total > 1.0 + 1e-12 {
        return Err(format!("probabilities sum to {total}"));
    }
    let all = sum((0..check.lights).map(|i| contribution(LightId(i))));
    let moments = exact.moments(&contribution);
    if (moments.mean - all).abs() > 1e-9 * all.abs() {
        return Err(format!("lights that contribute {:e} of {all:e} are never drawn", all - moments.mean));
    }

    // Draw, and compare each report.
    let mut counts = vec![0u32; check.lights as usize];
    let (mut nothing, mut terms) = (0, Vec::with_capacity(check.samples as usize));
    for i in 0..check.samples {
        let Some(sample) = sampler.sample(receiver, &mut Decisions::new(Random::new(check.seed, 0, i)))
        else {
            nothing += 1;
            continue;
        };
        let Some(count) = counts.get_mut(sample.light.0 as usize) else {
            return Err(format!("light {} was drawn, of {}", sample.light.0, check.lights));
        };
        *count += 1;
        // Asking a tree for one probability costs as much as a sample, so ask for some.
        if *count <= 4 {
            let pmf = sampler.pmf(receiver, sample.light);
            if !(sample.pmf > 0.0 && (pmf - sample.pmf).abs() <= 1e-6 * pmf) {
                return Err(format!(
                    "light {} was reported with {:e}, asked {pmf:e}",
                    sample.light.0, sample.pmf
                ));
            }
        }
        terms.push(contribution(sample.light) / sample.pmf);
    }
    let mean = sum(terms.into_iter()) / f64::from(check.samples);
    let standard_error = (moments.variance / f64::from(check.samples)).sqrt();
    if (mean - all).abs() > 4.0 * standard_error + 1e-9 * all.abs() {
        return Err(format!("a mean of {mean:e} where {all:e} ± {standard_error:e} was expected"));
    }

    // Compare the counts, what draws nothing being one more outcome.
    let mut expected = vec![0.0; check.lights as usize];
    exact.samples().iter().for_each(|s| expected[s.light.0 as usize] = s.pmf);
    expected.push((1.0 - total).max(0.0));
    counts.push(nothing);
    let p_value = chi_squared_p_value(&counts, &expected)?;
    if p_value < check.significance {
        return Err(format!(
            "chi² of the counts has a p-value of {p_value:e}, below {:e}",
            check.significance
        ));
    }
    Ok(SamplerReport { nothing, p_value, mean, standard_error })
}

/// Far from all lights a sampler must go by intensity: each probability is within `tolerance` of that,
/// relatively.
pub fn check_far_away<R: ?Sized>(
    sampler: &impl LightSampler<R>,
    far_receiver: &R,
    intensities: &[f32],
    tolerance: f64,
) -> Result<(), Failure> {
    let total = sum(intensities.iter().map(|&intensity| f64::from(intensity)));
    for (i, &intensity) in intensities.iter().enumerate() {
        let (pmf, wanted) = (sampler.pmf(far_receiver, LightId(i as u32)), f64::from(intensity) / total);
        if (pmf - wanted).abs() > tolerance * wanted {
            return Err(format!("far away light {i} has probability {pmf:e}, by intensity {wanted:e}"));
        }
    }
    Ok(())
}

/// A batch sampler: unused entries are [`WeightedLight::NONE`], weights are positive and finite, the same
/// request gives the same rows, rows do not depend on how the batch is cut, and the mean over `requests`
/// batches of each receiver's weighted sum is within `tolerance` of the sum of all contributions, relatively.
pub fn check_batch<S: BatchLightSampler>(
    sampler: &mut S,
    receivers: &[S::Receiver],
    request: &SampleRequest,
    requests: u32,
    lights: u32,
    contribution: impl Fn(&S::Receiver, LightId) -> f64,
    tolerance: f64,
) -> Result<(), Failure> {
    let width = request.lights_per_receiver as usize;
    let mut run = |receivers: &[S::Receiver], request: &SampleRequest| {
        let mut out = vec![WeightedLight { light: LightId(0), weight: f32::NAN }; receivers.len() * width];
        sampler.sample_batch(receivers, request, &mut out).map_err(|error| error.to_string())?;
        Ok::<_, Failure>(out)
    };
    let rows = run(receivers, request)?;
    if run(receivers, request)? != rows {
        return Err("the same request gives other rows".into());
    }
    let half = receivers.len() / 2;
    let second = SampleRequest { first_stream: request.first_stream.wrapping_add(half as u32), ..*request };
    if run(&receivers[half..], &second)?[..] != rows[half * width..] {
        return Err("half of the batch gives other rows".into());
    }

    let mut sums = vec![0.0; receivers.len()];
    for i in 0..requests {
        let out = run(receivers, &SampleRequest { index: request.index.wrapping_add(i), ..*request })?;
        for ((receiver, row), estimate) in receivers.iter().zip(out.chunks(width.max(1))).zip(&mut sums) {
            for entry in row {
                if entry.light == LightId::NONE {
                    if *entry != WeightedLight::NONE {
                        return Err(format!("an unused entry weighs {}", entry.weight));
                    }
                } else if entry.light.0 >= lights || !(entry.weight > 0.0 && entry.weight.is_finite()) {
                    return Err(format!("light {} of {lights} with weight {}", entry.light.0, entry.weight));
                } else {
                    *estimate += f64::from(entry.weight) * contribution(receiver, entry.light);
                }
            }
        }
    }
    for (i, (receiver, estimate)) in receivers.iter().zip(&sums).enumerate() {
        let all = sum((0..lights).map(|light| contribution(receiver, LightId(light))));
        let mean = estimate / f64::from(requests);
        if (mean - all).abs() > tolerance * all {
            return Err(format!("receiver {i} gets {mean:e} on average, not {all:e}"));
        }
    }
    Ok(())
}

/// How far two implementations of rays agreed in [`check_batch_rays`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RayAgreement {
    /// Rays that hit anything, by the reference.
    pub hits: usize,
    /// Rays that only one of both found a hit for.
    pub hit_or_not: usize,
    /// Rays that both found a hit for, on different primitives or at distances that differ by more than the
    /// tolerance.
    pub elsewhere: usize,
    /// Segments with anything between their ends, by the reference.
    pub blocked: usize,
    /// Segments that only one of both took for blocked.
    pub blocked_or_not: usize,
}

impl RayAgreement {
    /// All disagreements.
    pub const fn differ(&self) -> usize {
        self.hit_or_not + self.elsewhere + self.blocked_or_not
    }
}

/// A batch of rays against a reference for the same geometry: answers do not depend on how the batch is cut,
/// a hit lies on its ray with weights of a point of a triangle, and at most `tolerated` rays and segments are
/// answered otherwise. `tolerance` is the relative error of a distance.
///
/// Where rays pass edges within rounding two right implementations differ: give as many as the rays that aim
/// there.
pub fn check_batch_rays<B: BatchRayQueries, Q: RayQueries>(
    batch: &mut B,
    reference: &Q,
    rays: &[Ray],
    segments: &[Segment],
    tolerance: f32,
    tolerated: usize,
) -> Result<RayAgreement, Failure> {
    let failed = |error: B::Error| format!("a batch failed: {error}");
    let mut agreement = RayAgreement::default();
    let mut scratch = Q::Scratch::default();

    // Nearest hits, in one batch and in two.
    let mut hits = vec![None; rays.len()];
    batch.closest_batch(rays, &mut hits).map_err(failed)?;
    let mut parts = vec![None; rays.len()];
    let middle = rays.len() / 3;
    batch.closest_batch(&rays[..middle], &mut parts[..middle]).map_err(failed)?;
    batch.closest_batch(&rays[middle..], &mut parts[middle..]).map_err(failed)?;
    if let Some(i) = (0..rays.len()).find(|&i| hits[i] != parts[i]) {
        return Err(format!("ray {i}: {:?} in one batch, {:?} in two", hits[i], parts[i]));
    }
    for (i, (ray, hit)) in rays.iter().zip(&hits).enumerate() {
        if let Some(RayHit { t, u, v, .. }) = hit
            && !(*t > 0.0 && *t < ray.t_max && *u >= -1e-6 && *v >= -1e-6 && u + v <= 1.0 + 1e-6)
        {
            return Err(format!("ray {i} ends at {}: {hit:?}", ray.t_max));
        }
        let expected = reference.closest(ray, &mut scratch);
        agreement.hits += usize::from(expected.is_some());
        match (hit, expected) {
            (Some(a), Some(b)) => {
                let same = a.primitive == b.primitive && (a.t - b.t).abs() <= tolerance * b.t;
                agreement.elsewhere += usize::from(!same);
            }
            (a, b) => agreement.hit_or_not += usize::from(a.is_some() != b.is_some()),
        }
    }

    // The same for segments.
    let mut occluded = vec![false; segments.len()];
    batch.occluded_batch(segments, &mut occluded).map_err(failed)?;
    let mut parts = vec![false; segments.len()];
    let middle = segments.len() / 3;
    batch.occluded_batch(&segments[..middle], &mut parts[..middle]).map_err(failed)?;
    batch.occluded_batch(&segments[middle..], &mut parts[middle..]).map_err(failed)?;
    if let Some(i) = (0..segments.len()).find(|&i| occluded[i] != parts[i]) {
        return Err(format!("segment {i}: {} in one batch, {} in two", occluded[i], parts[i]));
    }
    for (segment, &occluded) in segments.iter().zip(&occluded) {
        let expected = reference.occluded(segment, &mut scratch);
        agreement.blocked += usize::from(expected);
        agreement.blocked_or_not += usize::from(expected != occluded);
    }
    if agreement.differ() > tolerated {
        return Err(format!("{} of {tolerated} tolerated answers differ: {agreement:?}", agreement.differ()));
    }
    Ok(agreement)
}

/// Probability, for a right sampler, of counts at least as far from what is expected as these: Pearson's chi²
/// test.
///
/// Outcomes of which fewer than 5 are expected are pooled, the least expected first, so that the distribution
/// of the statistic is the known one. A count where nothing is expected is an error.
pub fn chi_squared_p_value(counts: &[u32], probabilities: &[f64]) -> Result<f64, Failure> {
    assert_eq!(counts.len(), probabilities.len(), "one probability per count");
    let samples = sum(counts.iter().map(|&count| f64::from(count)));
    let mut outcomes: Vec<(f64, f64)> = Vec::new();
    for (i, (&count, &p)) in counts.iter().zip(probabilities).enumerate() {
        if p > 0.0 {
            outcomes.push((p * samples, f64::from(count)));
        } else if count > 0 {
            return Err(format!("outcome {i} has probability 0 and came {count} times"));
        }
    }
    outcomes.sort_by(|a, b| a.0.total_cmp(&b.0));

    let (mut chi_squared, mut cells) = (0.0, 0u32);
    let (mut expected, mut count) = (0.0, 0.0);
    let mut rest = outcomes.iter().map(|outcome| outcome.0).sum::<f64>();
    for &(e, c) in &outcomes {
        (expected, count, rest) = (expected + e, count + c, rest - e);
        // Close the pool when it is full, unless what is left could not fill another.
        if expected >= 5.0 && (rest >= 5.0 || rest <= 1e-9 * samples) {
            chi_squared += (count - expected) * (count - expected) / expected;
            cells += 1;
            (expected, count) = (0.0, 0.0);
        }
    }
    if cells < 2 {
        return Ok(1.0);
    }
    Ok(upper_gamma(0.5 * f64::from(cells - 1), 0.5 * chi_squared))
}

/// The regularised incomplete gamma function Q(a, x): series below a + 1, continued fraction (Lentz) above.
fn upper_gamma(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 1.0;
    }
    let front = (a * x.ln() - x - ln_gamma(a)).exp();
    if x < a + 1.0 {
        let (mut term, mut total, mut n) = (1.0 / a, 1.0 / a, a);
        while term > total * 1e-15 {
            n += 1.0;
            term *= x / n;
            total += term;
        }
        (1.0 - front * total).clamp(0.0, 1.0)
    } else {
        let mut b = x + 1.0 - a;
        let (mut c, mut d) = (1e300, 1.0 / b);
        let mut h = d;
        for i in 1..10_000 {
            let an = -f64::from(i) * (f64::from(i) - a);
            b += 2.0;
            d = 1.0 / (an * d + b);
            c = b + an / c;
            h *= c * d;
            if (c * d - 1.0).abs() < 1e-15 {
                break;
            }
        }
        (front * h).clamp(0.0, 1.0)
    }
}

/// ln Γ(x) for x > 0: Stirling's series after shifting x above 10.
fn ln_gamma(x: f64) -> f64 {
    let (mut x, mut shift) = (x, 0.0);
    while x < 10.0 {
        shift += x.ln();
        x += 1.0;
    }
    let r = 1.0 / (x * x);
    let series = (1.0 / 12.0 - r * (1.0 / 360.0 - r * (1.0 / 1260.0 - r / 1680.0))) / x;
    (x - 0.5) * x.ln() - x + 0.5 * core::f64::consts::TAU.ln() + series - shift
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Abramowitz and Stegun 1964, table 26.7 and the closed forms of 1 and 2 degrees of freedom.
    #[test]
    fn incomplete_gamma_has_the_tabled_values() {
        for (dof, chi_squared, q) in [
            (1.0, 3.841_458_82, 0.05),
            (2.0, 9.210_340_37, 0.01),
            (10.0, 18.307_038_05, 0.05),
            (100.0, 149.449_253, 0.001),
        ] {
            let found = upper_gamma(0.5 * dof, 0.5 * chi_squared);
            assert!((found - q).abs() < 1e-8, "{dof} {found} {q}");
        }
        assert!((upper_gamma(1.0, 30.0) - (-30.0f64).exp()).abs() < 1e-25);
    }

    #[test]
    fn chi_squared_finds_a_loaded_die() {
        let fair = [1.0 / 6.0; 6];
        assert!(chi_squared_p_value(&[1003, 985, 1010, 1022, 979, 1001], &fair).unwrap() > 0.5);
        assert!(chi_squared_p_value(&[1133, 855, 1010, 1022, 979, 1001], &fair).unwrap() < 1e-4);
        assert!(chi_squared_p_value(&[10, 1], &[1.0, 0.0]).is_err());
    }
}
