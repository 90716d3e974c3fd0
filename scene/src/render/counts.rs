//! What rendering counts.

/// What happened, for people and for tests. Sums over all samples, the same for any number of threads.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counts {
    /// Segments asked for occlusion.
    pub shadow_rays: u64,
    /// Rays asked for their nearest hit.
    pub closest_hit_rays: u64,
    /// Contributions of one light to one point that were evaluated.
    pub light_evaluations: u64,
    /// Nodes of light trees visited.
    pub node_visits: u64,
    /// Nodes of all cuts.
    pub cut_nodes: u64,
    /// Nodes of the largest cut.
    pub cut_nodes_max: u64,
    /// Points that a cut was made for.
    pub cuts: u64,
    /// Points or samples for which a method fell back to another.
    pub fallbacks: u64,
    /// Contributions cut off by a clamp that was asked for, or at zero by a method whose approximation may go
    /// below it.
    pub clamped: u64,
    /// Luminance that this took away, summed over samples as they would have entered the picture; divide by
    /// [`samples`](Self::samples). Below zero where what was cut off was negative.
    pub clamped_luminance: f64,
    /// Samples that were infinite or not a number and are left out of the mean.
    pub non_finite: u64,
    /// Chains of glass and mirrors given up.
    pub chains_cut: u64,
    /// Camera samples taken.
    pub samples: u64,
}

impl Counts {
    /// Adds what another unit of work counted.
    pub fn add(&mut self, other: &Self) {
        self.shadow_rays += other.shadow_rays;
        self.closest_hit_rays += other.closest_hit_rays;
        self.light_evaluations += other.light_evaluations;
        self.node_visits += other.node_visits;
        self.cut_nodes += other.cut_nodes;
        self.cut_nodes_max = self.cut_nodes_max.max(other.cut_nodes_max);
        self.cuts += other.cuts;
        self.fallbacks += other.fallbacks;
        self.clamped += other.clamped;
        self.clamped_luminance += other.clamped_luminance;
        self.non_finite += other.non_finite;
        self.chains_cut += other.chains_cut;
        self.samples += other.samples;
    }

    /// Notes a cut of `nodes` nodes.
    pub fn add_cut(&mut self, nodes: u64) {
        self.cuts += 1;
        self.cut_nodes += nodes;
        self.cut_nodes_max = self.cut_nodes_max.max(nodes);
    }
}
