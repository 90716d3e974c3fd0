// What the kernels that build a tree share: where things are in its memory while it is built.
//
// All of it lies in the buffer of the nodes. Sorting keeps two sets of ids and keys where inner nodes will
// be, A and B in turn, and the table of digits after them; the last pass leaves the ids at the very start,
// where no leaf is written, and once the leaves are written the inner nodes may be. So a tree takes no memory
// besides its own.

struct BuildParams {
    // Lights in the buffer.
    lights: u32,
    // Words of each array of keys or ids: the lights there is room for, and up to a multiple of 4.
    stride: u32,
    // Blocks of keys there is room for.
    blocks: u32,
    // Parts in which the lights are surveyed, at most 256.
    parts: u32,
}

// One pass of the sort.
struct SortPass {
    // Lowest bit of the digit.
    shift: u32,
    // First words of the ids and of the keys that are read, and that are written; multiples of 4.
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
const BLOCK: u32 = 1024u;

// The key of a light that is left out.
const LEFT_OUT: u32 = 0xffffffffu;

// The table of digits, after both sets: a row of blocks for each digit, then the number of all keys of each
// digit.
fn table(params: BuildParams, digit: u32, block: u32) -> u32 {
    return 4u * params.stride + digit * params.blocks + block;
}

fn total(params: BuildParams, digit: u32) -> u32 {
    return 4u * params.stride + DIGITS * params.blocks + digit;
}
