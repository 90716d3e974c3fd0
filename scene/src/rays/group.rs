//! Up to 64 rays from one point through the tree together: from a light to a tile of receivers.
//!
//! Rays of one octant share which planes they enter first, so one interval test, on the smallest and largest
//! inverse direction, rejects children for all of them; what is left is tested 8 rays at once. The rays that
//! are still concerned travel with each link as a mask. Triangles are tested ray by ray, so answers are those
//! of single rays.

/// Rays that walk together: the bits of a mask.
pub(super) const GROUP: usize = 64;
/// Below this many a group costs more than its rays one by one.
pub(super) const FEW: usize = 4;

/// Rays from one point, to be compiled for the operations in scope.
macro_rules! group_kernel {
    ([$(#[$feature:meta])*]) => {
        /// The blocked among `rays`, all of one octant and origin, as a mask.
        #[inline]
        $(#[$feature])*
        fn group<F: HitFilter>(
            bvh: &WideBvh, rays: &[Traced], filter: &F, stack: &mut [(u32, u64); STACK],
        ) -> u64 {
            // Transpose the inverse directions, and bound them.
            let mut rows = [[[0f32; LANES]; GROUP / LANES]; 3];
            let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
            for (i, ray) in rays.iter().enumerate() {
                for k in 0..3 {
                    rows[k][i / LANES][i % LANES] = ray.inverse[k];
                    low[k] = low[k].min(ray.inverse[k]);
                    high[k] = high[k].max(ray.inverse[k]);
                }
            }
            let (shared, octets) = (rays[0], rays.len().div_ceil(LANES));
            let all = u64::MAX >> (GROUP - rays.len());
            let (mut open, mut active, mut link, mut sp) = (all, all, Link::ROOT, 0usize);
            loop {
                if !link.is_leaf() {
                    // Reject children that none of the directions can reach.
                    let node = &bvh.nodes[link.0 as usize];
                    let (mut enter, mut leave) = (splat(0.0), splat(shared.t_max));
                    for k in 0..3 {
                        let side = shared.side[k] & 1;
                        let near = sub(load(&node.planes[k][side]), splat(shared.enter[k]));
                        let far = sub(load(&node.planes[k][side ^ 1]), splat(shared.leave[k]));
                        enter = max(min(mul(near, splat(low[k])), mul(near, splat(high[k]))), enter);
                        leave = min(max(mul(far, splat(low[k])), mul(far, splat(high[k]))), leave);
                    }
                    let mut children = le(enter, leave);
                    // Test each child that is left, 8 rays at once.
                    while children != 0 {
                        let i = next_bit(&mut children);
                        let near = [0, 1, 2].map(|k| node.planes[k][shared.side[k] & 1][i] - shared.enter[k]);
                        let far = [0, 1, 2].map(|k| node.planes[k][shared.side[k] & 1 ^ 1][i] - shared.leave[k]);
                        let mut hits = 0u64;
                        for octet in 0..octets {
                            let (mut enter, mut leave) = (splat(0.0), splat(shared.t_max));
                            for k in 0..3 {
                                let inverse = load(&rows[k][octet]);
                                enter = max(mul(splat(near[k]), inverse), enter);
                                leave = min(mul(splat(far[k]), inverse), leave);
                            }
                            hits |= u64::from(le(enter, leave)) << (octet * LANES);
                        }
                        if hits & active != 0 {
                            stack[sp & TOP] = (node.child[i], hits & active);
                            sp += 1;
                        }
                    }
                } else {
                    let mut todo = active;
                    while todo != 0 {
                        let i = todo.trailing_zeros() as usize;
                        todo &= todo - 1;
                        if leaf_blocks(bvh, link, &rays[i], filter) {
                            open &= !(1 << i);
                        }
                    }
                }
                // Go on with the next link that concerns an open ray.
                loop {
                    if sp == 0 || open == 0 {
                        return all & !open;
                    }
                    sp -= 1;
                    let (next, mask) = stack[sp & TOP];
                    if mask & open != 0 {
                        (link, active) = (Link(next), mask & open);
                        break;
                    }
                }
            }
        }

        $(#[$feature])*
        pub(super) fn occluded_from<F: HitFilter>(
            bvh: &WideBvh, from: Vec3, targets: &[Vec3], occluded: &mut [bool], filter: &F, scratch: &mut Scratch,
        ) {
            let origin = from * bvh.scale.factor;
            let (mut bins, mut fill) = ([[0u32; GROUP]; 8], [0usize; 8]);
            // Sort into octants, and trace those that are full; the last eight turns trace what is left.
            for i in 0..targets.len() + 8 {
                let octant = if let Some(&to) = targets.get(i) {
                    let direction = to * bvh.scale.factor - origin;
                    let octant = direction.is_negative_bitmask() as usize;
                    bins[octant][fill[octant]] = i as u32;
                    fill[octant] += 1;
                    if fill[octant] < GROUP {
                        continue;
                    }
                    octant
                } else {
                    i - targets.len()
                };
                let which = &bins[octant][..fill[octant]];
                fill[octant] = 0;

                // A few cost less one by one, and so do those whose `t` had to be scaled.
                let Scratch { single, group: stack, bundle, .. } = scratch;
                let (mut index, mut n) = ([0u32; GROUP], 0);
                for &j in which {
                    let segment = Segment { from, to: targets[j as usize] };
                    match Traced::segment(&segment, &bvh.scale) {
                        Some(ray) if which.len() >= FEW && ray.t_max == 1.0 => {
                            (bundle[n], index[n]) = (ray, j);
                            n += 1;
                        }
                        Some(ray) => occluded[j as usize] = blocker(bvh, &ray, filter, single).is_some(),
                        None => occluded[j as usize] = false,
                    }
                }
                if n > 0 {
                    let blocked = group(bvh, &bundle[..n], filter, stack);
                    for (k, &j) in index[..n].iter().enumerate() {
                        occluded[j as usize] = blocked >> k & 1 != 0;
                    }
                }
            }
        }
    };
}
pub(super) use group_kernel;
