// What the kernels that build a tree share: where things are in its memory while it is built.
//
// All of it lies in the buffer of the nodes. Sorting keeps two sets of ids and keys where inner nodes will be, A and B in turn, and the table of
// digits after them; the last pass leaves the ids at the very start, where no leaf is written, and once the leaves are written
// the inner nodes may be. So a tree takes no memory besides its own.

struct BuildParams {
    // Lights in the buffer.
    lights: u32,
    // Lights there is room for.
    capacity: u32,
    // Blocks of keys there is room for.
    blocks: u32,
    // Parts in which the lights are surveyed, at most 256.
    parts: u32,
}

// One pass of the sort.
struct SortPass {
    // Lowest bit of the digit.
    shift: u32,
    // First words of the ids and of the keys that are read, and that are written.
    from_ids: u32,
    from_keys: u32,
    to_ids: u32,
    to_keys: u32,
    // Whether ids are still the places themselves, and lights that are left out among them.
    first: u32,
    // Whether only the ids are wanted.
    last: u32,
}

// Bits of a digit.
const DIGIT_BITS: u32 = 6u;
const DIGITS: u32 = 64u;
// Keys that one workgroup of 64 threads sorts.
const BLOCK: u32 = 512u;

// The key of a light that is left out.
const LEFT_OUT: u32 = 0xffffffffu;
