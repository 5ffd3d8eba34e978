// A tensor's layout as push constants: element of channel c at (y, x), see runtime/tensor.hpp.
struct TensorLayout {
    uint origin;
    uint row;
    uint plane;
    uint block;
};

uint element(TensorLayout layout_, uint c, uint y, uint x) {
    return layout_.origin + c / layout_.block * layout_.plane + y * layout_.row +
           x * layout_.block + c % layout_.block;
}
