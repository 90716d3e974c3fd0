//! Which texels a surface covers, and where on it they are.
//!
//! Conservative: a texel belongs to the lightmap if any part of its square is on a triangle, even where its
//! centre is not. Filters read such texels, and a centre beside the surface would be lit as if it were
//! outside (Godot's leaks #51638 and #98685). Each sample of a texel is the point of the surface that lies
//! under it, or the nearest one there is.

use glam::{DVec2, Vec2};

use super::layout::Layout;

/// A point on a triangle of an object. 8 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Site {
    /// Index of the triangle in its mesh.
    pub(super) triangle: u32,
    /// Barycentric weight of the second corner, in 65535ths.
    pub(super) u: u16,
    /// Of the third; both together are at most 65535.
    pub(super) v: u16,
}

impl Site {
    fn new(triangle: u32, [u, v]: [f64; 2]) -> Self {
        const ONE: f64 = 65535.0;
        // Never on an edge, which may lie on another surface.
        let u = (u * ONE).round().clamp(1.0, ONE - 2.0);
        let v = (v * ONE).round().clamp(1.0, ONE - 1.0 - u);
        Self { triangle, u: u as u16, v: v as u16 }
    }

    /// Weights of the second and third corner.
    pub(super) fn barycentric(self) -> [f64; 2] {
        [f64::from(self.u) / 65535.0, f64::from(self.v) / 65535.0]
    }
}

/// What was found on the way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CoverageReport {
    /// Texels that belong to surfaces.
    pub texels: u64,
    /// Triangles whose chart has no area, or is not finite: they get no texels of their own.
    pub flat_triangles: u64,
    /// Texels whose centre lies in two triangles at once: charts that overlap; the first triangle has them.
    pub overlapping: u64,
    /// Triangles that reach beyond their page: what is outside has no texels.
    pub outside: u64,
}

/// Texels of one object, in order.
pub(super) struct ObjectTexels {
    /// Column and row within the object's rectangle, by blocks of 8 × 8.
    pub(super) pixels: Vec<[u16; 2]>,
    /// `samples` of each.
    pub(super) sites: Vec<Site>,
}

/// Where the samples of a texel are, in [0, 1)²: Hammersley's points, moved so that their mean is the middle
/// for every power of two.
pub(super) fn sample_positions(samples: u32) -> Vec<Vec2> {
    let places = f64::from(samples.next_power_of_two());
    let radical = |i: u32| f64::from(i.reverse_bits()) / 2f64.powi(32) + 0.5 / places;
    (0..samples)
        .map(|i| Vec2::new(((f64::from(i) + 0.5) / f64::from(samples)) as f32, radical(i) as f32))
        .collect()
}

/// The texels of an object. Pixels are relative to the first of its placement.
pub(super) fn cover(
    layout: &Layout,
    object: usize,
    samples: &[Vec2],
    report: &mut CoverageReport,
) -> ObjectTexels {
    let mut texels = ObjectTexels { pixels: Vec::new(), sites: Vec::new() };
    let Some(placement) = &layout.objects[object] else { return texels };
    let mesh = &layout.meshes[placement.charted as usize];
    let (origin, end) = placement.pixels();
    let end = [end[0].min(layout.size[0]), end[1].min(layout.size[1])];
    let width = end[0].saturating_sub(origin[0]);
    let height = end[1].saturating_sub(origin[1]);
    let corners = |triangle: &[u32; 3]| {
        let origin = Vec2::new(origin[0] as f32, origin[1] as f32);
        triangle.map(|v| (placement.texel(mesh.uvs[v as usize]) - origin).as_dvec2())
    };

    // Pairs of texel and triangle that touch, by texel.
    let mut touching: Vec<(u32, u32)> = Vec::new();
    for (index, triangle) in mesh.triangles.iter().enumerate() {
        let corners = corners(triangle);
        let Some(triangle) = Triangle::new(corners) else {
            report.flat_triangles += 1;
            continue;
        };
        let limit = DVec2::new(f64::from(width), f64::from(height));
        if triangle.min.cmplt(DVec2::splat(-1e-3)).any() || triangle.max.cmpgt(limit + 1e-3).any() {
            report.outside += 1;
        }
        let first = triangle.min.floor().max(DVec2::ZERO);
        let last = triangle.max.ceil().min(limit);
        for y in first.y as u32..last.y.max(0.0) as u32 {
            for x in first.x as u32..last.x.max(0.0) as u32 {
                if triangle.touches(DVec2::new(f64::from(x), f64::from(y))) {
                    touching.push((block_order(x, y, width), index as u32));
                }
            }
        }
    }
    touching.sort_unstable();

    for of_texel in touching.chunk_by(|a, b| a.0 == b.0) {
        let [x, y] = from_block_order(of_texel[0].0, width);
        let low = DVec2::new(f64::from(x), f64::from(y));
        let candidates = of_texel.iter().filter_map(|&(_, index)| {
            Triangle::new(corners(&mesh.triangles[index as usize])).map(|triangle| (index, triangle))
        });
        let centre = low + 0.5;
        if candidates.clone().filter(|(_, triangle)| triangle.holds_inside(centre)).count() > 1 {
            report.overlapping += 1;
        }
        texels.pixels.push([x as u16, y as u16]);
        report.texels += 1;
        for &sample in samples {
            let at = low + sample.as_dvec2();
            // The nearest; inside is at distance 0, and of equals the first.
            let nearest = candidates.clone().map(|(index, triangle)| (triangle.nearest(at), index));
            let nearest = nearest.min_by(|((d, _), i), ((e, _), j)| d.total_cmp(e).then(i.cmp(j)));
            if let Some(((_, weights), index)) = nearest {
                let weights =
                    Triangle::new(corners(&mesh.triangles[index as usize])).map(|t| t.inwards(weights));
                texels.sites.push(Site::new(index, weights.unwrap_or([1.0 / 3.0; 2])));
            }
        }
    }
    texels
}

/// Order of texels by blocks of 8 × 8, so that neighbours in the list are neighbours on the surface.
fn block_order(x: u32, y: u32, width: u32) -> u32 {
    let blocks = width.div_ceil(8);
    ((y / 8) * blocks + x / 8) * 64 + (y % 8) * 8 + x % 8
}

fn from_block_order(index: u32, width: u32) -> [u32; 2] {
    let blocks = width.div_ceil(8);
    let (block, within) = (index / 64, index % 64);
    [(block % blocks) * 8 + within % 8, (block / blocks) * 8 + within / 8]
}

/// A triangle in texels, counter-clockwise or clockwise.
struct Triangle {
    corners: [DVec2; 3],
    min: DVec2,
    max: DVec2,
    /// Twice the area, with the sign of the winding.
    double_area: f64,
}

impl Triangle {
    fn new(corners: [DVec2; 3]) -> Option<Self> {
        let [a, b, c] = corners;
        let double_area = (b - a).perp_dot(c - a);
        (double_area != 0.0 && double_area.is_finite()).then(|| Self {
            corners,
            min: a.min(b).min(c),
            max: a.max(b).max(c),
            double_area,
        })
    }

    /// Whether the texel with this lower corner shares more than its border with the triangle: no edge has
    /// the whole square on its outside.
    fn touches(&self, low: DVec2) -> bool {
        let sign = self.double_area.signum();
        (0..3).all(|i| {
            let (a, b) = (self.corners[i], self.corners[(i + 1) % 3]);
            let inward = DVec2::new(a.y - b.y, b.x - a.x) * sign;
            // The corner of the square that is farthest in.
            let far = low + DVec2::new(f64::from(inward.x > 0.0), f64::from(inward.y > 0.0));
            inward.dot(far - a) > 0.0
        }) && low.cmplt(self.max).all()
            && (low + 1.0).cmpgt(self.min).all()
    }

    fn weights(&self, at: DVec2) -> [f64; 2] {
        let [a, b, c] = self.corners;
        let to = at - a;
        [to.perp_dot(c - a) / self.double_area, (b - a).perp_dot(to) / self.double_area]
    }

    /// The point moved off the edges by a part of a texel, towards the middle. On an edge it would lie in the
    /// plane of the next wall, and see what is behind it.
    fn inwards(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        const TEXELS: f64 = 1.0 / 32.0;
        let [a, b, c] = self.corners;
        let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a)).sqrt();
        // Heights are at least this, so that a step of weight moves the point at least so far off each edge.
        let height = self.double_area.abs() / longest;
        let least = (TEXELS / height).min(1.0 / 6.0);
        let keep = 1.0 - 3.0 * least;
        [least + keep * u, least + keep * v]
    }

    /// Inside by more than rounding.
    fn holds_inside(&self, at: DVec2) -> bool {
        let [u, v] = self.weights(at);
        u.min(v).min(1.0 - u - v) > 1e-4
    }

    /// Squared distance to the triangle, and the weights of its nearest point.
    fn nearest(&self, at: DVec2) -> (f64, [f64; 2]) {
        let [u, v] = self.weights(at);
        if u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
            return (0.0, [u, v]);
        }
        let edge = |i: usize| {
            let (a, b) = (self.corners[i], self.corners[(i + 1) % 3]);
            let along = ((at - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
            let along = if along.is_nan() { 0.0 } else { along };
            let weights = match i {
                0 => [along, 0.0],
                1 => [1.0 - along, along],
                _ => [0.0, 1.0 - along],
            };
            ((a + along * (b - a)).distance_squared(at), weights)
        };
        let (first, rest) = (edge(0), [edge(1), edge(2)]);
        rest.into_iter().fold(first, |best, other| if other.0 < best.0 { other } else { best })
    }
}

#[cfg(test)]
mod tests {
    use super::super::layout::{ChartedMesh, Placement};
    use super::*;

    fn layout(uvs: &[Vec2], triangles: &[[u32; 3]], size: u32) -> Layout {
        Layout {
            size: [size, size],
            pages: 1,
            meshes: vec![ChartedMesh {
                vertices: (0..uvs.len() as u32).collect(),
                uvs: uvs.to_vec(),
                triangles: triangles.to_vec(),
                ..ChartedMesh::default()
            }],
            objects: vec![Some(Placement {
                charted: 0,
                page: 0,
                min: Vec2::ZERO,
                max: Vec2::splat(size as f32),
            })],
            charts: 1,
        }
    }

    fn covered(uvs: &[Vec2], triangles: &[[u32; 3]]) -> (ObjectTexels, CoverageReport) {
        let mut report = CoverageReport::default();
        let texels = cover(&layout(uvs, triangles, 16), 0, &sample_positions(4), &mut report);
        assert_eq!(texels.sites.len(), 4 * texels.pixels.len());
        (texels, report)
    }

    /// A triangle that is smaller than a texel and misses its centre still has that texel.
    #[test]
    fn no_triangle_is_too_small() {
        let at = |x: f32, y: f32| Vec2::new(x, y) / 16.0;
        let (texels, report) = covered(&[at(3.1, 5.1), at(3.2, 5.1), at(3.1, 5.2)], &[[0, 1, 2]]);
        assert_eq!(texels.pixels, [[3, 5]]);
        assert_eq!(report, CoverageReport { texels: 1, ..CoverageReport::default() });
    }

    /// Against the dumbest question: does any of many points of the texel lie in the triangle? Both windings.
    #[test]
    fn coverage_is_conservative_and_no_more() {
        let at = |x: f32, y: f32| Vec2::new(x, y) / 16.0;
        for triangle in [[0, 1, 2], [0, 2, 1]] {
            let uvs = [at(1.3, 2.2), at(13.7, 4.9), at(6.1, 14.6)];
            let (texels, _) = covered(&uvs, &[triangle]);
            let corners = triangle.map(|i: u32| (uvs[i as usize] * 16.0).as_dvec2());
            let whole = Triangle::new(corners).unwrap();
            for y in 0..16u16 {
                for x in 0..16u16 {
                    let points = (0..10_000).map(|i| {
                        DVec2::new(
                            f64::from(x) + f64::from(i % 100) / 99.0,
                            f64::from(y) + f64::from(i / 100) / 99.0,
                        )
                    });
                    let any = points.clone().any(|p| whole.holds_inside(p));
                    let found = texels.pixels.contains(&[x, y]);
                    assert!(!any || found, "({x}, {y}) is missed");
                    // What is found beyond that only grazes a corner.
                    let near = points.clone().any(|p| whole.nearest(p).0 < 0.03f64.powi(2));
                    assert!(!found || near, "({x}, {y}) is too much");
                }
            }
        }
    }

    #[test]
    fn what_is_wrong_with_charts_is_counted() {
        let at = |x: f32, y: f32| Vec2::new(x, y) / 16.0;
        let uvs = [at(0.0, 0.0), at(8.0, 0.0), at(0.0, 8.0), at(8.0, 8.0), at(4.0, 4.0), at(20.0, 4.0)];
        // Degenerate, overlapping with flipped winding, and beyond the page.
        let (_, report) = covered(&uvs, &[[0, 3, 4]]);
        assert_eq!((report.flat_triangles, report.texels), (1, 0));
        let (_, report) = covered(&uvs, &[[0, 1, 2], [0, 2, 1]]);
        assert!(report.overlapping > 20);
        let (_, report) = covered(&uvs, &[[1, 5, 3]]);
        assert_eq!(report.outside, 1);
        let (_, report) = covered(&uvs, &[[0, 1, 2], [1, 3, 2]]);
        assert_eq!((report.overlapping, report.texels), (0, 64), "neighbours share an edge, not texels");
    }

    #[test]
    fn samples_fill_the_texel() {
        assert_eq!(sample_positions(1), [Vec2::splat(0.5)]);
        for count in [2, 4, 8, 16] {
            let mean = sample_positions(count).iter().sum::<Vec2>() / count as f32;
            assert!((mean - 0.5).length() < 1e-6, "{mean}");
        }
        assert!(sample_positions(13).iter().all(|p| p.cmpge(Vec2::ZERO).all() && p.cmplt(Vec2::ONE).all()));
    }
}
