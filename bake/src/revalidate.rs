//! Path validation: what edits made of the paths.
//!
//! Luksch, Wimmer and Schwärzler 2019, section 4.2. Lights come by invalid flux, and of each first the paths
//! that are known to be invalid. A changed vertex goes with all that follow it.

use lighttree::Ray;

use crate::LightKey;
use crate::baker::Baker;
use crate::forest::{Members, NONE};
use crate::paths::{Hit, PathInfo};
use crate::trace::{Job, Trace, Traced, trace_jobs};

/// A path to be looked at.
#[derive(Clone, Copy, Debug)]
struct Task {
    key: LightKey,
    /// Number among its light's paths.
    index: u32,
    path: u32,
}

/// Paths that one task of the thread pool looks at.
const PART: usize = 256;

impl Baker {
    /// Looks at up to `count` paths; returns how many.
    pub(crate) fn validate_paths(&mut self, count: usize, trace: &Trace<'_>) -> usize {
        let tasks = self.take_tasks(count);
        if tasks.is_empty() {
            return 0;
        }
        let parts =
            lighttree::parallel::map(tasks.chunks(PART).collect(), |part: &[Task]| self.look_at(part, trace));
        for (part, results) in tasks.chunks(PART).zip(parts) {
            for (task, result) in part.iter().zip(results) {
                self.stats.paths_validated += 1;
                match result {
                    Some((known, traced)) => self.apply(task, known, &traced),
                    None => {
                        let info = PathInfo { edit: self.edit, ..self.paths.info(task.path) };
                        self.paths.set_info(task.path, info);
                    }
                }
            }
        }
        if self.paths_pending() == 0 {
            self.log.clear();
            self.objects.clear();
            self.paths.all_valid(self.edit);
            self.paths.trim();
            self.forest.trim();
            if !self.primed {
                self.primed = true;
                self.restore();
            }
        }
        tasks.len()
    }

    /// Paths that have not been looked at since the last edit that may concern them.
    pub(crate) fn paths_pending(&self) -> usize {
        self.lights.values().map(|lamp| lamp.known.len() + (lamp.light.paths - lamp.cursor) as usize).sum()
    }

    fn take_tasks(&mut self, count: usize) -> Vec<Task> {
        let mut tasks = Vec::with_capacity(count.min(1 << 16));
        // Paths known to be invalid, the light with the most of their flux first.
        let mut order: Vec<(i64, LightKey)> = self
            .lights
            .iter()
            .filter(|(_, lamp)| !lamp.known.is_empty())
            .map(|(&key, lamp)| (-lamp.invalid, key))
            .collect();
        order.sort_unstable();
        for (_, key) in order {
            let lamp = self.lights.get_mut(&key).expect("the light was found");
            let taken = lamp.known.len().min(count - tasks.len());
            let before = lamp.known.len();
            let known = lamp.known.drain(..taken);
            tasks.extend(known.map(|index| Task { key, index, path: lamp.first_path + index }));
            if lamp.known.is_empty() {
                // A list of all of a light's paths is not kept for the next time.
                lamp.known = Vec::new();
            }
            lamp.invalid = (lamp.invalid as f64 * (before - taken) as f64 / before as f64) as i64;
        }
        // Then all that may be.
        for (&key, lamp) in &mut self.lights {
            let taken = (lamp.light.paths - lamp.cursor).min((count - tasks.len()) as u32);
            let indices = lamp.cursor..lamp.cursor + taken;
            tasks.extend(indices.map(|index| Task { key, index, path: lamp.first_path + index }));
            lamp.cursor += taken;
        }
        // A path may be known and come along with all others, too.
        let mut seen = std::collections::BTreeSet::new();
        let is_valid = |info: PathInfo| info.counted && info.edit == self.edit;
        tasks.retain(|task| !is_valid(self.paths.info(task.path)) && seen.insert(task.path));
        tasks
    }

    /// For each path what became of it, and how many of its vertices were kept without looking; `None` where
    /// nothing can have changed.
    fn look_at(&self, part: &[Task], trace: &Trace<'_>) -> Vec<Option<(u32, Traced)>> {
        let mut results = Vec::with_capacity(part.len());
        results.resize_with(part.len(), || None);
        let (mut which, mut jobs) = (Vec::new(), Vec::new());
        for (i, task) in part.iter().enumerate() {
            let lamp = &self.lights[&task.key];
            let mut job =
                Job { key: task.key, light: &lamp.light, tree: &lamp.tree, index: task.index, known: None };
            let Some(known) = self.first_suspect(task, &job) else { continue };
            if known > 0 {
                let vertex = self.paths.on_path(task.path).nth(known as usize - 1).expect("a kept vertex");
                job.known = Some((known, *self.paths.hit(vertex)));
            }
            which.push((i, known));
            jobs.push(job);
        }
        for ((i, known), traced) in which.into_iter().zip(trace_jobs(&self.rules, &jobs, trace)) {
            results[i] = Some((known, traced));
        }
        results
    }

    /// Number of the first vertex that may have changed; as many as there are for a last segment that
    /// escapes.
    fn first_suspect(&self, task: &Task, job: &Job<'_>) -> Option<u32> {
        let info = self.paths.info(task.path);
        if !info.counted || self.lights[&task.key].changed > info.edit {
            return Some(0);
        }
        if !self.params.skip_unaffected && !self.log.is_empty() {
            return Some(0);
        }
        let emission = self.rules.emission(job);
        let (mut from, mut toward) = (emission.origin, emission.direction);
        let mut count = 0;
        let mut last: Option<Hit> = None;
        for vertex in self.paths.on_path(task.path) {
            let hit = *self.paths.hit(vertex);
            let changed = self.objects.get(&hit.object).copied().unwrap_or(0);
            if changed > info.edit || self.log.crosses(info.edit, from, hit.position, false) {
                return Some(count);
            }
            from = hit.position;
            last = Some(hit);
            count += 1;
        }
        if !info.escaped {
            return None;
        }
        if let Some(hit) = &last {
            let (Ray { direction, .. }, _) = self.rules.scatter(job, count - 1, hit, info.power)?;
            toward = direction;
        }
        self.log.crosses(info.edit, from, from + toward, true).then_some(count)
    }

    /// Replaces what changed of a path, of which `known` vertices were kept.
    fn apply(&mut self, task: &Task, known: u32, traced: &Traced) {
        self.stats.paths_traced += 1;
        self.stats.rays += traced.hits.len() as u64 + u64::from(traced.escaped);
        self.stats.unsound_hits += u64::from(traced.unsound);
        let before = self.paths.info(task.path);
        let after = PathInfo { counted: true, escaped: traced.escaped, edit: self.edit, power: traced.power };
        let old: Vec<u32> = self.paths.on_path(task.path).collect();
        // Keep what is the same to the bit. A path of another power is another path.
        let mut kept = known as usize;
        if before.power.to_bits() == after.power.to_bits() || known > 0 {
            let new = &traced.hits;
            while old.get(kept).is_some_and(|&v| new.get(kept - known as usize) == Some(self.paths.hit(v))) {
                kept += 1;
            }
        }
        let new = &traced.hits[kept - known as usize..];
        let same = kept == old.len() && new.is_empty() && before.escaped == after.escaped;
        if same && before.counted && before.power.to_bits() == after.power.to_bits() {
            self.paths.set_info(task.path, after);
            return;
        }
        self.stats.paths_changed += 1;

        // Whose receivers changed: whose segment ends elsewhere.
        let last = (kept > 0).then(|| old[kept - 1]);
        let target = |hit: Option<&Hit>, escaped: bool| {
            hit.map(|hit| hit.position).or(escaped.then_some(glam::Vec3::INFINITY))
        };
        let old_target = target(old.get(kept).map(|&v| self.paths.hit(v)), before.escaped);
        let moved = old_target != target(new.first(), after.escaped);

        // The first segment belongs to the piece of the lamp that it leaves from.
        let lamp = &self.lights[&task.key];
        let piece = lamp.nodes[traced.piece as usize];
        let origin = self.rules.emission(&Job {
            key: task.key,
            light: &lamp.light,
            tree: &lamp.tree,
            index: task.index,
            known: None,
        });
        let first_segment = |hit: Option<&Hit>, info: PathInfo| self.paths.segment(origin.origin, hit, info);
        let old_first = first_segment(old.first().map(|&v| self.paths.hit(v)), before);
        let new_first = if kept > 0 { old.first().map(|&v| self.paths.hit(v)) } else { new.first() };
        let new_first = first_segment(new_first, after);

        // Take out what changed, change the path, and put in what is new.
        for &vertex in &old[kept..] {
            self.forest.remove(vertex, &mut self.paths, &mut self.cut);
        }
        let member_before = last.map(|vertex| self.paths.member(vertex));
        self.paths.truncate(task.path, last);
        self.paths.set_info(task.path, after);
        let (mut tail, mut added) = (last, Vec::with_capacity(new.len()));
        for &hit in new {
            let vertex = self.paths.append(task.path, tail, hit);
            added.push(vertex);
            tail = Some(vertex);
        }
        if let (Some(vertex), Some(before)) = (last, member_before) {
            let after = self.paths.member(vertex);
            if before.sums != after.sums {
                self.forest.adjust(&before, &after, &mut self.cut);
            }
        }
        for vertex in added {
            self.forest.insert(vertex, &mut self.paths, &mut self.cut);
        }
        let mut node = piece;
        while node != NONE {
            let entry = &mut self.forest.nodes[node as usize];
            if before.counted {
                entry.sums.subtract(&old_first);
            }
            entry.sums.add(&new_first);
            node = entry.parent;
        }
        self.forest.mark(piece);
        if moved {
            self.change_receivers(last, piece, after.power);
        }
    }

    /// A path that left a vertex, or a piece of a lamp, goes elsewhere now.
    fn change_receivers(&mut self, last: Option<u32>, piece: u32, power: f32) {
        let states = &self.cut.states;
        let selected = |state: u32| state != NONE && !states[state as usize].refined;
        let node = match last {
            Some(vertex) => self.forest.find(&self.paths.member(vertex), |node| selected(node.state)),
            None => {
                let mut node = piece;
                while !selected(self.forest.nodes[node as usize].state) {
                    node = self.forest.nodes[node as usize].parent;
                }
                node
            }
        };
        let state = self.forest.nodes[node as usize].state;
        let flux = self.forest.units.flux(glam::Vec3::splat(power));
        self.cut.change_receivers(state, flux);
    }
}
