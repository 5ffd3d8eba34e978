// A tensor's layout as push constants: element of channel c at (y, x), see runtime/tensor.hpp.
struct TensorLayout {
    uint origin;
    uint row;
    uint plane; // elements a channel: a block of channels takes block times as many
    uint block; // a power of two
};

uint element(TensorLayout layout_, uint c, uint y, uint x) {
    const uint lane = c & (layout_.block - 1u); // no division: lavapipe does those one lane at a time
    return layout_.origin + (c - lane) * layout_.plane + y * layout_.row + x * layout_.block + lane;
}
