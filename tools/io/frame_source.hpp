#pragma once
#include <cstddef>

#include "tools/io/image.hpp"

namespace ecir::io {

/// The frames that a camera's own file holds beside its events.
class FrameSource {
public:
    FrameSource() = default;
    virtual ~FrameSource() = default;
    FrameSource(const FrameSource&) = delete;
    FrameSource& operator=(const FrameSource&) = delete;

    /// Counted from 0. Throws Error(bad_input) naming the file and the frame.
    virtual Image read(size_t frame) = 0;
};

} // namespace ecir::io
