// Cuts that blocks of pixels share without a guard.

fn is_admitted(representative: Receiver, own: Receiver) -> bool {
    return true;
}
