#include "layers/windowed.hpp"

#include <algorithm>

namespace ecir {
namespace {

/// What instances may take together, in images.
constexpr double kMostImages = 1.5;

/// Puts what is kept of a window's frame into an image, width pixels wide, of which `weight`, where
/// there is one, keeps the rest.
void paste(std::span<const float> frame, const Window& window, std::span<const float> weight,
           std::span<const float> blurry, std::span<float> image, uint32_t width) {
    const auto& [computed, kept] = window;
    for (uint32_t y = kept.top; y < kept.bottom; ++y) {
        const size_t to = size_t{y} * width + kept.left;
        const size_t from =
            size_t{y - computed.top} * computed.width() + (kept.left - computed.left);
        for (uint32_t x = 0; x < kept.width(); ++x) {
            const float still = weight.empty() ? 0 : blurry[to + x];
            const float share = weight.empty() ? 1 : weight[to + x];
            image[to + x] =
                share == 1 ? frame[from + x] : still + share * (frame[from + x] - still);
        }
    }
}

} // namespace

WindowedMethod::WindowedMethod(std::unique_ptr<const Method> method, uint32_t width,
                               uint32_t height)
    : method_(std::move(method)), width_(width), height_(height) {}

bool WindowedMethod::drop_idle(const Instance& except) {
    return std::erase_if(instances_, [&](const auto& instance) {
               return instance.get() != &except && instance->begun == 0;
           }) > 0;
}

std::shared_ptr<WindowedMethod::Instance> WindowedMethod::instance_for(const PixelRect& rect) {
    const auto known = std::ranges::find_if(instances_, [&](const auto& instance) {
        return instance->width == rect.width() && instance->height == rect.height();
    });
    if (known != instances_.end()) {
        std::rotate(known, known + 1, instances_.end());
        return instances_.back();
    }
    const double most = kMostImages * row_pixels(width_) * height_;
    double area = double{1} * row_pixels(rect.width()) * rect.height();
    for (const auto& instance : instances_) {
        area += instance->area();
    }
    for (auto oldest = instances_.begin(); oldest != instances_.end() && area > most;) {
        if ((*oldest)->begun == 0) {
            area -= (*oldest)->area();
            oldest = instances_.erase(oldest);
        } else {
            ++oldest;
        }
    }
    instances_.push_back(std::make_shared<Instance>(
        Instance{rect.width(), rect.height(), method_->resized(rect.height(), rect.width())}));
    return instances_.back();
}

void WindowedMethod::begin_window(const FrameInput& input, const Window& window, Begun& begun) {
    const PixelRect& rect = window.computed;
    const auto instance = instance_for(rect);
    FrameInput part = input;
    Events events;
    std::vector<float> blurry;
    if (rect != PixelRect{0, 0, width_, height_}) {
        events = crop_events(input.events, rect);
        blurry = crop_image(input.blurry, width_, rect);
        part.events = events.view();
        part.blurry = blurry;
    }
    try {
        instance->method->begin(part);
    } catch (const Error& error) {
        if (error.code() != ExitCode::resources || !drop_idle(*instance)) {
            throw;
        }
        instance->method->begin(part); // with what the other sizes held
    }
    ++instance->begun;
    begun.parts.push_back({instance, window});
    operations_ += instance->method->operations();
}

void WindowedMethod::begin(const FrameInput& input, const Regions& regions) {
    drop_abandoned();
    Begun begun;
    begun.parts.reserve(regions.windows.size());
    begun.weight = regions.weight;
    if (!regions.whole(width_, height_) || !regions.weight.empty()) {
        begun.blurry.assign(input.blurry.begin(), input.blurry.end());
    }
    begun_.push_back(std::move(begun));
    operations_ = 0;
    try {
        for (const Window& window : regions.windows) {
            begin_window(input, window, begun_.back());
        }
    } catch (...) {
        begun_.back().abandoned = true; // its windows' turn comes after those of frames before it
        throw;
    }
}

std::span<const float> WindowedMethod::take(const Part& part) {
    --part.instance->begun;
    return part.instance->method->finish();
}

void WindowedMethod::drop_abandoned() {
    while (!begun_.empty() && begun_.front().abandoned) {
        for (const Part& part : begun_.front().parts) {
            take(part);
        }
        begun_.erase(begun_.begin());
    }
}

std::vector<float> WindowedMethod::finish(std::span<const size_t> order) {
    drop_abandoned();
    const Begun begun = std::move(begun_.at(0));
    begun_.erase(begun_.begin());
    const size_t pixels = size_t{width_} * height_;
    std::vector<float> result;
    result.reserve(order.size() * pixels);
    for (size_t i = 0; i < order.size() && !begun.blurry.empty(); ++i) {
        result.insert(result.end(), begun.blurry.begin(), begun.blurry.end());
    }
    result.resize(order.size() * pixels);
    work_.clear();
    for (const Part& part : begun.parts) {
        const auto frames = take(part);
        work_.push_back(part.instance->method->work());
        const size_t size = part.window.computed.area();
        for (size_t i = 0; i < order.size(); ++i) {
            paste(frames.subspan(i * size, size), part.window, begun.weight, begun.blurry,
                  std::span(result).subspan(order[i] * pixels, pixels), width_);
        }
    }
    return result;
}

} // namespace ecir
