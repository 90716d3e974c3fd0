//! Clusters of the shading points of a picture: seeds and rounds.

use clustering::{ClusterParams, Metric, OrientedPoint, Seeding, cluster};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use glam::Vec3;

/// What a camera in a room with balls sees, a point per pixel.
fn view(width: u32, height: u32) -> (Vec<OrientedPoint>, Vec<u32>) {
    let pixels: Vec<u32> = (0..width * height).collect();
    let ball = |x: f32, y: f32| {
        let (u, v) = (8.0 * x - (8.0 * x).floor() - 0.5, 8.0 * y - (8.0 * y).floor() - 0.5);
        let z = (0.2 - u * u - v * v).max(0.0).sqrt();
        if z > 0.0 {
            (Vec3::new(x, y, z / 8.0), Vec3::new(u, v, z).normalize())
        } else {
            (Vec3::new(x, y, 0.0), Vec3::Z)
        }
    };
    let point = |&pixel: &u32| {
        let (x, y) = ((pixel % width) as f32 / width as f32, (pixel / width) as f32 / height as f32);
        let (position, normal) = if y > 0.6 { (Vec3::new(x, 0.6, y - 0.6), Vec3::Y) } else { ball(x, y) };
        OrientedPoint { position, normal }
    };
    (pixels.iter().map(point).collect(), pixels)
}

fn clusters(c: &mut Criterion) {
    let (width, height) = (640, 360);
    let (points, pixels) = view(width, height);
    let metric = Metric::new(0.3, 1.0).expect("a metric");
    let mut group = c.benchmark_group("640x360");
    group.throughput(Throughput::Elements(points.len() as u64)).sample_size(10);
    for count in [1600, 5000] {
        for (name, seeding) in
            [("screen", Seeding::Screen { width, pixels: &pixels }), ("octree", Seeding::Octree)]
        {
            let params = ClusterParams::with_count(count);
            group.bench_function(BenchmarkId::new(name, count), |b| {
                b.iter(|| cluster(&points, seeding, &metric, &params).expect("clusters"));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, clusters);
criterion_main!(benches);
