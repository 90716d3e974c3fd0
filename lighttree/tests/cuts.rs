//! What must hold of cuts and their refinement, on any tree.

use std::ops::Range;

use lighttree::{
    Cut, CutPolicy, CutSelector, Hierarchy, ItemRanges, NodeId, overlay, rng::Random, select_cut,
};
use proptest::prelude::*;

/// A random tree of any branching factor; children before later siblings' children, as builders lay them out.
#[derive(Clone, Debug)]
struct AnyTree {
    children: Vec<Range<u32>>,
    items: Vec<Range<u32>>,
}

impl AnyTree {
    #[expect(clippy::single_range_in_vec_init, reason = "a list of ranges that begins with the root's")]
    fn new(items: u32, seed: u32) -> Self {
        let mut tree = Self { children: vec![0..0], items: vec![0..items] };
        let mut open = if items > 0 { vec![0usize] } else { vec![] };
        while let Some(node) = open.pop() {
            let Range { start, end } = tree.items[node];
            let mut random = Random::new(seed, node as u32, 0);
            let mut splits: Vec<u32> =
                (0..1 + random.u32() % 3).map(|_| start + random.u32() % (end - start).max(1)).collect();
            splits.retain(|&s| s > start);
            splits.sort_unstable();
            splits.dedup();
            let starts: Vec<u32> = std::iter::once(start).chain(splits).chain([end]).collect();
            let chain = starts.len() == 2; // one child of the same items
            if end - start == 1 || chain && !random.u32().is_multiple_of(4) {
                continue;
            }
            let first = tree.items.len() as u32;
            tree.children[node] = first..first + starts.len() as u32 - 1;
            for pair in starts.windows(2) {
                open.push(tree.items.len());
                tree.items.push(pair[0]..pair[1]);
                tree.children.push(0..0);
            }
        }
        tree
    }
}

impl Hierarchy for AnyTree {
    fn root(&self) -> Option<NodeId> {
        (!self.items[0].is_empty()).then_some(NodeId(0))
    }
    fn children(&self, node: NodeId) -> Range<u32> {
        self.children[node.0 as usize].clone()
    }
}

impl ItemRanges for AnyTree {
    fn items(&self, node: NodeId) -> Range<u32> {
        self.items[node.0 as usize].clone()
    }
}

/// Errors drawn by node, and a log of what was asked.
struct Drawn {
    seed: u32,
    tolerance: f64,
    inside: i64,
}

impl Drawn {
    fn error(&self, node: NodeId) -> f64 {
        Random::new(self.seed, node.0, 1).f64()
    }
}

impl CutPolicy for Drawn {
    type Value = NodeId;
    fn enter(&mut self, node: NodeId, parent: Option<&NodeId>) -> (NodeId, f64) {
        assert!(parent.is_some() == (node.0 != 0), "only the root has no parent");
        self.inside += 1;
        (node, self.error(node))
    }
    fn leave(&mut self, node: NodeId, value: &NodeId) {
        assert_eq!(node, *value);
        self.inside -= 1;
    }
    fn tolerance(&self) -> f64 {
        self.tolerance
    }
}

/// Worst-first refinement by the dumbest loop: a list, searched whole.
fn plain(tree: &AnyTree, policy: &Drawn, max_nodes: usize) -> Vec<NodeId> {
    let mut nodes: Vec<NodeId> = tree.root().into_iter().collect();
    loop {
        let by_error =
            |a: &&NodeId, b: &&NodeId| policy.error(**a).total_cmp(&policy.error(**b)).then(b.cmp(a));
        let Some(&worst) = nodes.iter().max_by(by_error) else { break };
        let children = tree.children(worst);
        let fits = nodes.len() - 1 + children.len() <= max_nodes;
        if policy.error(worst) <= policy.tolerance || children.is_empty() || !fits {
            break;
        }
        nodes.retain(|&n| n != worst);
        nodes.extend(children.map(NodeId));
    }
    nodes.sort_by_key(|&n| tree.items(n).start);
    nodes
}

fn random_cut(tree: &AnyTree, seed: u32) -> Cut<u32> {
    let start = Cut::at_root(tree, |n| n.0);
    (0..6).fold(start, |cut, round| {
        cut.refine_where(tree, |n, _| Random::new(seed, n.0, round).f32() < 0.6, |n| n.0)
    })
}

proptest! {
    #[test]
    fn refinement_equals_the_plain_loop(
        items in 0u32..300, seed in any::<u32>(), max_nodes in 0usize..80, tolerance in prop_oneof![Just(0.0), 0.0f64..1.0],
    ) {
        let tree = AnyTree::new(items, seed);
        let mut policy = Drawn { seed, tolerance, inside: 0 };
        let cut = select_cut(&tree, &mut policy, max_nodes);
        prop_assert_eq!(cut.check(&tree), Ok(()));
        prop_assert_eq!(cut.nodes(), &plain(&tree, &policy, max_nodes)[..]);
        prop_assert_eq!(cut.values(), cut.nodes(), "each value stays with its node");
        prop_assert_eq!(policy.inside, cut.len() as i64);
        prop_assert!(cut.len() <= max_nodes.max(1));
    }

    #[test]
    fn a_used_selector_is_as_good_as_a_new_one(seed in any::<u32>()) {
        let (large, small) = (AnyTree::new(300, seed), AnyTree::new(20, seed));
        let mut selector = CutSelector::default();
        let mut cut = Cut::default();
        for tree in [&large, &small, &large] {
            let mut policy = Drawn { seed, tolerance: 0.3, inside: 0 };
            selector.refine(tree, &mut policy, 50);
            prop_assert_eq!(selector.unordered().len() as i64, policy.inside);
            selector.drain_into(tree, &mut cut);
            let mut policy = Drawn { seed, tolerance: 0.3, inside: 0 };
            prop_assert_eq!(&cut, &select_cut(tree, &mut policy, 50));
        }
    }

    #[test]
    fn an_overlay_is_a_cut_and_names_what_covers(items in 1u32..300, seed in any::<u32>()) {
        let tree = AnyTree::new(items, seed);
        let (a, b) = (random_cut(&tree, seed), random_cut(&tree, !seed));
        prop_assert_eq!(a.check(&tree), Ok(()));
        let both: Vec<_> = overlay(&tree, &a, &b).collect();
        let nodes: Vec<NodeId> = both.iter().map(|t| t.0).collect();
        let finer = Cut::from_parts(nodes, vec![(); both.len()]);
        prop_assert_eq!(finer.check(&tree), Ok(()));
        for (node, i, j) in both {
            let (above_a, above_b) = (a.nodes()[i], b.nodes()[j]);
            let inside = |above| {
                let (n, m): (Range<u32>, Range<u32>) = (tree.items(node), tree.items(above));
                m.start <= n.start && n.end <= m.end
            };
            prop_assert!(inside(above_a) && inside(above_b) && (node == above_a || node == above_b));
        }
    }

    /// Cutting off, doubling or swapping any part of a valid cut is noticed.
    #[test]
    fn damage_is_noticed(items in 2u32..300, seed in any::<u32>(), which in any::<prop::sample::Index>(), kind in 0..3) {
        let tree = AnyTree::new(items, seed);
        let cut = random_cut(&tree, seed);
        prop_assume!(cut.len() > 1);
        let (i, mut nodes) = (which.index(cut.len() - 1), cut.nodes().to_vec());
        match kind {
            0 => drop(nodes.remove(i)),
            1 => nodes.insert(i, nodes[i]),
            _ => nodes.swap(i, i + 1),
        }
        let values = vec![(); nodes.len()];
        prop_assert!(Cut::from_parts(nodes, values).check(&tree).is_err());
    }
}

/// A path of 100,000 nodes, each with a leaf at its side: nothing recurses.
#[test]
fn a_chain_does_not_overflow_the_stack() {
    struct Chain(u32);
    impl Hierarchy for Chain {
        fn root(&self) -> Option<NodeId> {
            Some(NodeId(0))
        }
        fn children(&self, node: NodeId) -> Range<u32> {
            // Even nodes are inner: their children are 2 nodes further on.
            if node.0 % 2 == 1 || node.0 >= 2 * self.0 { 0..0 } else { node.0 + 1..node.0 + 3 }
        }
    }
    let chain = Chain(100_000);
    let mut nodes: Vec<NodeId> = (0..chain.0).map(|i| NodeId(2 * i + 1)).collect();
    nodes.push(NodeId(2 * chain.0));
    let cut = Cut::from_parts(nodes.clone(), vec![(); nodes.len()]);
    assert_eq!(cut.check(&chain), Ok(()));
    assert_eq!(overlay(&chain, &cut, &Cut::at_root(&chain, |_| ())).count(), nodes.len());
}
