// What every kernel that draws binds: what is asked for, the tree, receivers, and the rows of lights drawn for them.

@group(0) @binding(0) var<uniform> params: DrawParams;
@group(0) @binding(1) var<storage, read> header: TreeHeader;
@group(0) @binding(2) var<storage, read> nodes: array<PerfectNode>;
@group(0) @binding(3) var<storage, read> receivers: array<Receiver>;
@group(0) @binding(4) var<storage, read_write> drawn: array<WeightedLight>;
