//! Seams: where a surface goes on in another chart, both sides must look up the same light.
//!
//! Iwanicki, "Lighting Technology of The Last of Us", SIGGRAPH 2013 courses: along every such edge, points on
//! both sides are looked up as a renderer would, bilinearly, and the texels that take part are moved as
//! little as possible until these agree, in the sense of least squares. Edges with a crease, where light
//! truly differs, are left alone.

use std::collections::HashMap;

use glam::{DVec2, Vec3};

use super::layout::{ChartedMesh, Placement};

/// Weight of staying where it was, against agreement: small, for agreement is what is asked for.
const STAY: f64 = 1e-4;
/// Normals across an edge that differ by more than this cosine make it a crease.
const CREASE: f32 = 0.9;
/// Steps of conjugate gradients at most; tens are enough.
const STEPS: usize = 300;

/// An edge in two charts, in texels of the page.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Seam {
    a: [DVec2; 2],
    b: [DVec2; 2],
}

/// Edges of a mesh that lie in two charts, or twice in one, without a crease. Vertices are the same where
/// their positions are.
pub(super) fn find(
    mesh: &ChartedMesh,
    positions: &[Vec3],
    normals: &[Vec3],
    placement: &Placement,
) -> Vec<Seam> {
    type Key = [[u32; 3]; 2];
    struct Side {
        texels: [DVec2; 2],
        normals: [Vec3; 2],
    }
    let mut sides: HashMap<Key, Vec<Side>> = HashMap::new();
    let mut order: Vec<Key> = Vec::new();
    for triangle in &mesh.triangles {
        let host = triangle.map(|v| mesh.vertices[v as usize] as usize);
        let corners = host.map(|v| positions[v]);
        let Some(flat) = (corners[1] - corners[0]).cross(corners[2] - corners[0]).try_normalize() else {
            continue;
        };
        for i in 0..3 {
            let ends = [i, (i + 1) % 3];
            let bits = ends.map(|k| (corners[k] + 0.0).to_array().map(f32::to_bits));
            // The same direction on both sides.
            let (key, ends) =
                if bits[0] <= bits[1] { (bits, ends) } else { ([bits[1], bits[0]], [ends[1], ends[0]]) };
            let texels = ends.map(|k| placement.texel(mesh.uvs[triangle[k] as usize]).as_dvec2());
            let normals = ends.map(|k| normals.get(host[k]).copied().unwrap_or(flat));
            let known = sides.entry(key).or_insert_with(|| {
                order.push(key);
                Vec::new()
            });
            known.push(Side { texels, normals });
        }
    }
    let smooth = |a: &Side, b: &Side| (0..2).all(|k| a.normals[k].dot(b.normals[k]) > CREASE);
    let apart = |a: &Side, b: &Side| a.texels != b.texels;
    let mut seams = Vec::new();
    for key in order {
        for pair in
            sides[&key].windows(2).filter(|pair| smooth(&pair[0], &pair[1]) && apart(&pair[0], &pair[1]))
        {
            seams.push(Seam { a: pair[0].texels, b: pair[1].texels });
        }
    }
    seams
}

/// What stitching did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StitchReport {
    /// Edges that lie in two charts.
    pub seams: u64,
    /// Points along them at which both sides were compared.
    pub points: u64,
    /// The largest difference between both sides before, as a part of their mean, over points of at least a
    /// hundredth of the brightest.
    pub before: f64,
    /// The same afterwards.
    pub after: f64,
    /// Values that would have become negative, and were put to zero.
    pub negative: u64,
}

/// One point of a seam: texels and weights, those of the second side negative.
struct Row {
    texels: [u32; 8],
    weights: [f32; 8],
}

/// Makes both sides of seams agree on a page of `channels` values a texel. `filled` texels alone take part.
pub(super) fn stitch(
    seams: &[Seam],
    [width, height]: [u32; 2],
    channels: usize,
    values: &mut [f32],
    filled: &[bool],
) -> StitchReport {
    let mut report = StitchReport { seams: seams.len() as u64, ..StitchReport::default() };

    // Points half a texel apart, and unknowns for the texels that they look up.
    let mut unknowns: Vec<u32> = Vec::new();
    let mut index: HashMap<u32, u32> = HashMap::new();
    let mut rows: Vec<Row> = Vec::new();
    for seam in seams {
        let length = seam.a[0].distance(seam.a[1]).max(seam.b[0].distance(seam.b[1]));
        let steps = (2.0 * length).ceil().clamp(1.0, 65_536.0) as u32;
        for step in 0..=steps {
            let t = f64::from(step) / f64::from(steps);
            let (a, b) = (seam.a[0].lerp(seam.a[1], t), seam.b[0].lerp(seam.b[1], t));
            let (ta, wa) = bilinear(a, width, height);
            let (tb, wb) = bilinear(b, width, height);
            let texels = [ta[0], ta[1], ta[2], ta[3], tb[0], tb[1], tb[2], tb[3]];
            if texels.iter().any(|&t| !filled[t as usize]) {
                continue;
            }
            let texels = texels.map(|texel| {
                *index.entry(texel).or_insert_with(|| {
                    unknowns.push(texel);
                    unknowns.len() as u32 - 1
                })
            });
            rows.push(Row { texels, weights: [wa[0], wa[1], wa[2], wa[3], -wb[0], -wb[1], -wb[2], -wb[3]] });
        }
    }
    report.points = rows.len() as u64;
    if rows.is_empty() {
        return report;
    }

    for channel in 0..channels {
        let at = |i: usize| unknowns[i] as usize * channels + channel;
        let start: Vec<f64> = (0..unknowns.len()).map(|i| f64::from(values[at(i)])).collect();
        let x = solve(&rows, &start);
        report.before = report.before.max(worst(&rows, &start));
        report.after = report.after.max(worst(&rows, &x));
        for (i, &value) in x.iter().enumerate() {
            // Irradiance and the constant coefficient are never negative; others may be.
            let negative = value < 0.0 && channel < 3;
            report.negative += u64::from(negative);
            values[at(i)] = if negative { 0.0 } else { value as f32 };
        }
    }
    report
}

/// The four texels about a place and their weights, as a sampler that clamps to the edge has them.
fn bilinear(at: DVec2, width: u32, height: u32) -> ([u32; 4], [f32; 4]) {
    let limit = DVec2::new(f64::from(width) - 1.0, f64::from(height) - 1.0);
    let p = (at - 0.5).clamp(DVec2::ZERO, limit);
    let (low, part) = (p.floor(), p - p.floor());
    let (x, y) = (low.x as u32, low.y as u32);
    let (x1, y1) = ((x + 1).min(width - 1), (y + 1).min(height - 1));
    let (u, v) = (part.x as f32, part.y as f32);
    (
        [y * width + x, y * width + x1, y1 * width + x, y1 * width + x1],
        [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v],
    )
}

/// Both sides' difference at a point.
fn difference(row: &Row, x: &[f64]) -> f64 {
    row.texels.iter().zip(row.weights).map(|(&t, w)| f64::from(w) * x[t as usize]).sum()
}

/// `(WᵀW + STAY) x` for the rows W.
fn apply(rows: &[Row], x: &[f64], out: &mut [f64]) {
    for (out, x) in out.iter_mut().zip(x) {
        *out = STAY * x;
    }
    for row in rows {
        let d = difference(row, x);
        for (&t, w) in row.texels.iter().zip(row.weights) {
            out[t as usize] += f64::from(w) * d;
        }
    }
}

/// The x that minimises |W x|² + STAY |x - start|², by conjugate gradients.
fn solve(rows: &[Row], start: &[f64]) -> Vec<f64> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut x = start.to_vec();
    let mut product = vec![0.0; x.len()];
    apply(rows, &x, &mut product);
    let mut residual: Vec<f64> = start.iter().zip(&product).map(|(s, p)| STAY * s - p).collect();
    let mut direction = residual.clone();
    let mut squared = dot(&residual, &residual);
    let enough = 1e-16 * STAY * STAY * dot(start, start);
    for _ in 0..STEPS {
        if squared <= enough {
            break;
        }
        apply(rows, &direction, &mut product);
        let curvature = dot(&direction, &product);
        if curvature <= 0.0 {
            break;
        }
        let step = squared / curvature;
        for i in 0..x.len() {
            x[i] += step * direction[i];
            residual[i] -= step * product[i];
        }
        let next = dot(&residual, &residual);
        let ratio = next / squared;
        for (direction, residual) in direction.iter_mut().zip(&residual) {
            *direction = residual + ratio * *direction;
        }
        squared = next;
    }
    x
}

/// The largest difference between both sides as a part of their mean, where that is a hundredth of the
/// brightest or more.
fn worst(rows: &[Row], x: &[f64]) -> f64 {
    let mean = |row: &Row| {
        0.5 * row
            .texels
            .iter()
            .zip(row.weights)
            .map(|(&t, w)| f64::from(w.abs()) * x[t as usize])
            .sum::<f64>()
    };
    let brightest = rows.iter().map(mean).fold(0.0, f64::max);
    rows.iter()
        .map(|row| (difference(row, x).abs(), mean(row)))
        .filter(|&(_, mean)| mean > 0.01 * brightest)
        .fold(0.0, |worst, (difference, mean)| worst.max(difference / mean))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two strips of a page with different light meet in an edge: they agree afterwards, and texels far from
    /// the seam stay.
    #[test]
    fn both_sides_agree() {
        let size = [16u32, 16];
        let mut values: Vec<f32> =
            (0..256).map(|i| if i % 16 < 8 { 1.0 } else { 1.2 + 0.01 * (i / 16) as f32 }).collect();
        let before = values.clone();
        let filled = vec![true; 256];
        let seam = Seam {
            a: [DVec2::new(2.3, 1.0), DVec2::new(2.9, 14.0)],
            b: [DVec2::new(12.6, 14.5), DVec2::new(12.1, 2.0)],
        };
        let report = stitch(&[seam], size, 1, &mut values, &filled);
        assert!(report.before > 0.15 && report.after < 1e-3, "{report:?}");
        for (i, (a, b)) in values.iter().zip(&before).enumerate() {
            let near = (1..=3).contains(&(i % 16)) || (11..=13).contains(&(i % 16));
            assert!(near || a == b, "texel {i} has nothing to do with it");
            assert!((0.99..=1.36).contains(a), "what is stitched stays between both sides: {a}");
        }
        // Black stays black.
        let mut black = vec![0.0; 256];
        stitch(&[seam], size, 1, &mut black, &filled);
        assert!(black.iter().all(|&v| v == 0.0));
    }

    #[test]
    fn places_beyond_the_page_are_looked_up_at_its_edge() {
        let (texels, weights) = bilinear(DVec2::new(-3.0, 99.0), 4, 4);
        assert!(texels.iter().all(|&t| t < 16));
        assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-6);
    }
}
