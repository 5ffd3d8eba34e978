#pragma once
#include <memory>
#include <span>
#include <vector>

#include "layers/method.hpp"
#include "layers/regions.hpp"
#include "layers/shapes.hpp"

namespace ecir {

/// Runs a method on windows of images of one size and puts the frames together. For each size of
/// window there is one instance of the method, whose recorded program serves all windows of the
/// size, of this frame and later ones; those not used for longest go when all together take more
/// than one and a half images, counting rows as far apart as they are (row_pixels()).
class WindowedMethod {
public:
    /// `method`: any size; others are made from it by resized().
    WindowedMethod(std::unique_ptr<const Method> method, uint32_t width, uint32_t height);

    /// Starts on a frame; nothing of the input is needed afterwards. Where it throws nothing was
    /// started.
    void begin(const FrameInput& input, const Regions& regions);

    /// Of the oldest frame begun and not finished: times x height x width, not clipped, the i-th
    /// time in its ascending order at place order[i]; the blurry frame outside the windows.
    std::vector<float> finish(std::span<const size_t> order);

    /// Of the frame finished last, window by window.
    [[nodiscard]] const std::vector<MethodWork>& work() const { return work_; }

    /// Floating-point operations of all windows of the frame begun last; 0 before the first.
    [[nodiscard]] double operations() const { return operations_; }

private:
    struct Instance {
        uint32_t width;
        uint32_t height;
        std::unique_ptr<Method> method;
        size_t begun = 0; ///< windows, not finished
        [[nodiscard]] double area() const { return double{1} * row_pixels(width) * height; }
    };
    struct Part {
        std::shared_ptr<Instance> instance;
        Window window;
    };
    struct Begun {
        std::vector<Part> parts;
        std::vector<float> blurry; ///< empty where the one window is all
        std::vector<float> weight; ///< Regions::weight
        bool abandoned = false;
    };

    std::shared_ptr<Instance> instance_for(const PixelRect& rect);
    bool drop_idle(const Instance& except);
    void begin_window(const FrameInput& input, const Window& window, Begun& begun);
    static std::span<const float> take(const Part& part);
    void drop_abandoned();

    std::unique_ptr<const Method> method_;
    uint32_t width_;
    uint32_t height_;
    std::vector<std::shared_ptr<Instance>> instances_; ///< the one used last at the end
    std::vector<Begun> begun_;                         ///< the oldest first
    std::vector<MethodWork> work_;
    double operations_ = 0;
};

} // namespace ecir
