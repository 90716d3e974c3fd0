//! What `--json` says of a bake.

use bake::lightmap::{Image, StitchReport};
use serde_json::{Value, json};

use super::output::Written;
use super::state::hash_sums;
use super::{Bake, layout_params};
use crate::memory;

/// How long the parts took.
pub(super) struct Seconds {
    pub(super) load: f64,
    pub(super) unwrap: f64,
    pub(super) bake: f64,
    pub(super) write: f64,
    pub(super) total: f64,
}

/// The last line of standard output: `pages` as they were written.
pub(super) fn summary(bake: &Bake<'_>, pages: &[Image], written: &Written, seconds: &Seconds) -> Value {
    let (coverage, receivers, counts) = (bake.map.coverage(), bake.map.receivers(), bake.map.counts());
    let (stats, layout) = (bake.baker.stats(), bake.map.layout());
    let stitched = pages.iter().map(|page| page.stitched);
    let worst = |pick: fn(&StitchReport) -> f64| pages.iter().map(|p| pick(&p.stitched)).fold(0.0, f64::max);
    json!({
        "scene": bake.world.scene.name,
        "triangles": bake.world.scene.triangle_count(),
        "objects": bake.world.objects.len(),
        "lights": bake.world.lamps.iter().filter(|lamp| lamp.present).count(),
        "edits": bake.edits.len(),
        "size": layout.size, "pages": layout.pages, "charts": layout.charts,
        "texels": bake.map.texels(), "texels_per_unit": layout_params(bake.args, bake.settings, &bake.world).texels_per_unit,
        "clusters": bake.baker.clusters(), "virtual_lights": bake.map.live(), "path_vertices": bake.baker.path_vertices(),
        "updates": bake.updates, "accumulations": bake.accumulations,
        "paths": { "validated": stats.paths_validated, "traced": stats.paths_traced, "changed": stats.paths_changed },
        "seconds": { "load": seconds.load, "unwrap": seconds.unwrap, "bake": seconds.bake, "write": seconds.write, "total": seconds.total },
        "counts": {
            "flat_triangles": coverage.flat_triangles, "overlapping": coverage.overlapping, "outside": coverage.outside,
            "pushed": receivers.pushed, "dead": receivers.dead, "cut_off": counts.cut_off, "non_finite": counts.non_finite,
            "wrapped": counts.wrapped, "unsound_hits": stats.unsound_hits, "saturated": written.saturated,
            "dilated": pages.iter().map(|page| page.dilated).sum::<u64>(),
        },
        "seams": { "edges": stitched.map(|s| s.seams).sum::<u64>(), "before": worst(|s| s.before), "after": worst(|s| s.after) },
        "bytes": { "lightmap": bake.map.bytes(), "baker": bake.baker.bytes(), "rays": bake.geometry.0.rays.bytes(), "peak_rss": memory::peak_resident() },
        "sums": format!("{:016x}", hash_sums(&bake.map)),
        "exposure": written.exposure,
        "output": written.files,
    })
}
