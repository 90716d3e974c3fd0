//! One ray through the tree: the nearest hit, or any.

/// Closest hit and any hit, to be compiled for the operations in scope.
macro_rules! traverse_kernel {
    ([$(#[$feature:meta])*]) => {
        /// Entry distance of each child box, and the children that the ray may meet before `t_max`.
        #[inline]
        $(#[$feature])*
        fn boxes(node: &Node, ray: &Traced, t_max: f32) -> (V, u32) {
            let (mut enter, mut leave) = (splat(0.0), splat(t_max));
            for k in 0..3 {
                let near = load(&node.planes[k][ray.side[k] & 1]);
                let far = load(&node.planes[k][ray.side[k] & 1 ^ 1]);
                // What is accumulated comes second: where a plane's distance is not a number, it is ignored.
                enter = max(slab(near, ray.enter[k], ray.inverse[k], ray.enter_scaled[k]), enter);
                leave = min(slab(far, ray.leave[k], ray.inverse[k], ray.leave_scaled[k]), leave);
            }
            (enter, le(enter, leave))
        }

        /// Whether a triangle of this leaf stops the ray.
        #[inline]
        $(#[$feature])*
        fn leaf_blocks<F: HitFilter>(bvh: &WideBvh, link: Link, ray: &Traced, filter: &F) -> bool {
            let (first, last) = link.packets();
            for packet in &bvh.packets[first..=last] {
                let mut hits = triangles(packet, ray, ray.t_max).1;
                if hits != 0 && (F::ACCEPTS_ALL || !link.is_masked()) {
                    return true;
                }
                while hits != 0 {
                    if packet.accepts(next_bit(&mut hits), ray, filter) {
                        return true;
                    }
                }
            }
            false
        }

        /// The first leaf found that stops the ray. Children are visited in the order of the tree, the largest
        /// first: nearest first costs more than it saves where any hit will do.
        #[inline]
        $(#[$feature])*
        fn blocker<F: HitFilter>(bvh: &WideBvh, ray: &Traced, filter: &F, stack: &mut [u32; STACK]) -> Option<Link> {
            let (mut link, mut sp) = (Link::ROOT, 0usize);
            loop {
                if !link.is_leaf() {
                    let node = &bvh.nodes[link.0 as usize];
                    let mut hits = boxes(node, ray, ray.t_max).1;
                    if hits != 0 {
                        // Go on with the last child, leave the others for later.
                        loop {
                            link = Link(node.child[next_bit(&mut hits)]);
                            if hits == 0 {
                                break;
                            }
                            stack[sp & TOP] = link.0;
                            sp += 1;
                        }
                        continue;
                    }
                } else if leaf_blocks(bvh, link, ray, filter) {
                    return Some(link);
                }
                if sp == 0 {
                    return None;
                }
                sp -= 1;
                link = Link(stack[sp & TOP]);
            }
        }

        $(#[$feature])*
        pub(super) fn occluded<F: HitFilter>(
            bvh: &WideBvh, segment: &Segment, filter: &F, scratch: &mut Scratch,
        ) -> bool {
            let Some(ray) = Traced::segment(segment, &bvh.scale) else { return false };
            blocker(bvh, &ray, filter, &mut scratch.single).is_some()
        }

        $(#[$feature])*
        pub(super) fn occluded_each<F: HitFilter>(
            bvh: &WideBvh, segments: &[Segment], occluded: &mut [bool], filter: &F, scratch: &mut Scratch,
        ) {
            for (segment, occluded) in segments.iter().zip(occluded) {
                *occluded = Traced::segment(segment, &bvh.scale)
                    .is_some_and(|ray| blocker(bvh, &ray, filter, &mut scratch.single).is_some());
            }
        }

        $(#[$feature])*
        pub(super) fn occluded_via<F: HitFilter>(
            bvh: &WideBvh, segment: &Segment, last: &mut u32, filter: &F, scratch: &mut Scratch,
        ) -> bool {
            let Some(ray) = Traced::segment(segment, &bvh.scale) else { return false };
            let link = Link(*last);
            // Any value may come in: only a leaf of this tree is asked.
            if link.is_leaf() && link.packets().1 < bvh.packets.len() && leaf_blocks(bvh, link, &ray, filter) {
                return true;
            }
            match blocker(bvh, &ray, filter, &mut scratch.single) {
                Some(link) => {
                    *last = link.0;
                    true
                }
                None => false,
            }
        }

        $(#[$feature])*
        pub(super) fn closest<F: HitFilter>(
            bvh: &WideBvh, ray: &Ray, filter: &F, scratch: &mut Scratch,
        ) -> Option<RayHit> {
            let (traced, unit) = Traced::ray(ray, &bvh.scale)?;
            let (at, packet, lane) = nearest(bvh, &traced, filter, &mut scratch.near)?;
            let t = unit.user(at);
            let packet = &bvh.packets[packet];
            let [u, v] = packet.barycentric(lane, &traced);
            // Only the last rounding into the user's unit can bring the hit to the end of the ray.
            (t < ray.t_max).then_some(RayHit { t, primitive: packet.primitive(lane), u, v })
        }

        $(#[$feature])*
        pub(super) fn closest_each<F: HitFilter>(
            bvh: &WideBvh, rays: &[Ray], hits: &mut [Option<RayHit>], filter: &F, scratch: &mut Scratch,
        ) {
            for (ray, hit) in rays.iter().zip(hits) {
                *hit = closest(bvh, ray, filter, scratch);
            }
        }

        /// The nearest hit as (t, packet, lane); of equally near ones the lowest primitive.
        #[inline]
        $(#[$feature])*
        fn nearest<F: HitFilter>(
            bvh: &WideBvh, ray: &Traced, filter: &F, stack: &mut [(u32, f32); STACK],
        ) -> Option<(f32, usize, usize)> {
            let (mut link, mut sp) = (Link::ROOT, 0usize);
            let (mut best_t, mut best_primitive, mut best_lane) = (ray.t_max, u32::MAX, None);
            loop {
                if !link.is_leaf() {
                    let node = &bvh.nodes[link.0 as usize];
                    let (t, mut hits) = boxes(node, ray, best_t);
                    let (t, bottom) = (array(t), sp);
                    // Insert by distance, the nearest on top.
                    while hits != 0 {
                        let i = next_bit(&mut hits);
                        let mut j = sp;
                        sp += 1;
                        while j > bottom && stack[(j - 1) & TOP].1 < t[i] {
                            stack[j & TOP] = stack[(j - 1) & TOP];
                            j -= 1;
                        }
                        stack[j & TOP] = (node.child[i], t[i]);
                    }
                } else {
                    let (first, last) = link.packets();
                    for at in first..=last {
                        let packet = &bvh.packets[at];
                        // Equally near ones too, once there is a hit to compare with.
                        let limit = if best_lane.is_none() { ray.t_max } else { best_t.next_up() };
                        let (t, mut hits) = triangles(packet, ray, limit);
                        if hits == 0 {
                            continue;
                        }
                        let t = array(t);
                        while hits != 0 {
                            let lane = next_bit(&mut hits);
                            let primitive = packet.primitive(lane);
                            if (t[lane], primitive) < (best_t, best_primitive) && packet.accepts(lane, ray, filter) {
                                (best_t, best_primitive, best_lane) = (t[lane], primitive, Some((at, lane)));
                            }
                        }
                    }
                }
                // Skip what lies behind the hit.
                loop {
                    if sp == 0 {
                        return best_lane.map(|(packet, lane)| (best_t, packet, lane));
                    }
                    sp -= 1;
                    let (next, t) = stack[sp & TOP];
                    if t <= best_t {
                        link = Link(next);
                        break;
                    }
                }
            }
        }
    };
}
pub(super) use traverse_kernel;
