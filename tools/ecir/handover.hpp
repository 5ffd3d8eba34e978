#pragma once
#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <optional>
#include <utility>

namespace ecir::cli {

/// Hands items from one thread to another in order. At most `most` wait in between, so that a
/// thread that is ahead waits and memory stays bounded.
template <typename T> class Handover {
public:
    explicit Handover(size_t most) : most_(most) {}

    /// Waits for room; false, and the item is gone, once nobody takes any more.
    bool put(T item) {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return abandoned_ || items_.size() < most_; });
        if (abandoned_) {
            return false;
        }
        items_.push_back(std::move(item));
        changed_.notify_all();
        return true;
    }

    /// No more will come, but for what waits; with an error, take() throws it behind the last item.
    void close(std::exception_ptr error = {}) {
        const std::scoped_lock lock(mutex_);
        closed_ = true;
        error_ = std::move(error);
        changed_.notify_all();
    }

    /// Waits for an item; none after the last one.
    std::optional<T> take() {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return closed_ || !items_.empty(); });
        if (items_.empty()) {
            if (error_) {
                std::rethrow_exception(error_);
            }
            return std::nullopt;
        }
        std::optional<T> item(std::move(items_.front()));
        items_.pop_front();
        changed_.notify_all();
        return item;
    }

    /// Nothing more will be taken.
    void abandon() {
        const std::scoped_lock lock(mutex_);
        abandoned_ = true;
        items_.clear();
        changed_.notify_all();
    }

private:
    std::mutex mutex_;
    std::condition_variable changed_;
    std::deque<T> items_;
    size_t most_;
    bool closed_ = false;
    bool abandoned_ = false;
    std::exception_ptr error_;
};

} // namespace ecir::cli
