#pragma once
#include <cstdint>

namespace ecir {

/// How channels x height x width 4-byte values lie in memory:
/// [ceil(channels / block)][height + 2 halo][pitch][block], with `halo` zero rows above and below
/// and zero columns at both sides, so that a convolution reads over the border without a test.
/// block 1 and halo 0 is the dense planar form in which data goes up and down.
/// By rows (row_channels > 0, block 1): [height + 2 halo][row_channels][pitch] instead, the
/// channels' rows one after another.
struct Layout {
    uint32_t channels = 1;
    uint32_t height = 1;
    uint32_t width = 1;
    uint32_t block = 1;
    uint32_t halo = 0;
    uint32_t pitch = 0; ///< pixels from one row to the next; 0 for width + 2 halo
    uint32_t row_channels =
        0; ///< by rows: channels of the whole tensor, of which this may be a view

    [[nodiscard]] uint32_t row_pixels() const { return pitch != 0 ? pitch : width + 2 * halo; }
    [[nodiscard]] uint32_t blocks() const { return (channels + block - 1) / block; }
    /// Elements from one pixel row to the next.
    [[nodiscard]] uint64_t row_stride() const {
        return uint64_t{row_pixels()} * (row_channels > 0 ? row_channels : block);
    }
    /// Elements from one channel block to the next.
    [[nodiscard]] uint64_t plane_stride() const {
        return row_channels > 0 ? row_pixels() : (height + 2 * uint64_t{halo}) * row_stride();
    }
    /// Element of channel 0 at (0, 0).
    [[nodiscard]] uint64_t origin() const { return halo * row_stride() + uint64_t{halo} * block; }
    [[nodiscard]] uint64_t elements() const {
        return row_channels > 0 ? (height + 2 * uint64_t{halo} - 1) * row_stride() +
                                      uint64_t{channels} * row_pixels()
                                : blocks() * plane_stride();
    }
    [[nodiscard]] uint64_t offset(uint32_t channel, uint32_t y, uint32_t x) const {
        return origin() + channel / block * plane_stride() + y * row_stride() +
               uint64_t{x} * block + channel % block;
    }
};

/// A tensor of a Program: a name for a range of its memory, whose place is planned by finish().
class Tensor {
public:
    Tensor() = default;
    Tensor(uint32_t id, const Layout& layout) : id_(id), layout_(layout) {}

    [[nodiscard]] uint32_t id() const { return id_; }
    [[nodiscard]] const Layout& layout() const { return layout_; }
    /// Bytes from the start of the whole tensor to this view of it.
    [[nodiscard]] uint64_t byte_offset() const { return byte_offset_; }
    [[nodiscard]] uint64_t bytes() const { return layout_.elements() * 4; }

    /// The channels first, ..., first + count - 1; `first` must be a multiple of the block.
    [[nodiscard]] Tensor channels(uint32_t first, uint32_t count) const {
        Tensor view = *this;
        view.byte_offset_ += first / layout_.block * layout_.plane_stride() * 4;
        view.layout_.channels = count;
        return view;
    }

private:
    uint32_t id_ = UINT32_MAX;
    Layout layout_;
    uint64_t byte_offset_ = 0;
};

/// The alignment of storage bindings that every Vulkan device accepts.
constexpr uint64_t kBindingAlignment = 256;

/// A tensor's layout as the shaders see it (struct TensorLayout in shaders/tensor.glsl). A view
/// binds from the last aligned byte before it; `origin` bridges the rest.
struct PushLayout {
    uint32_t origin = 0;
    uint32_t row = 0;
    uint32_t plane = 0; ///< elements a channel
    uint32_t block = 1;

    PushLayout() = default;
    explicit PushLayout(const Tensor& tensor)
        : origin(static_cast<uint32_t>(tensor.layout().origin() +
                                       tensor.byte_offset() % kBindingAlignment / 4)),
          row(static_cast<uint32_t>(tensor.layout().row_stride())),
          plane(static_cast<uint32_t>(tensor.layout().plane_stride() / tensor.layout().block)),
          block(tensor.layout().block) {}
};
static_assert(sizeof(PushLayout) == 16);

} // namespace ecir
