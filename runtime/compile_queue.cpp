#include "runtime/compile_queue.hpp"

#include <algorithm>
#include <system_error>
#include <utility>

namespace ecir {

CompileQueue::~CompileQueue() {
    {
        const std::scoped_lock lock(mutex_);
        ends_ = true;
        tasks_.clear();
    }
    changed_.notify_all();
    for (std::thread& thread : threads_) {
        thread.join();
    }
}

CompileQueue::Pipeline CompileQueue::add(std::function<Handle<VkPipeline>()> make) {
    constexpr size_t kMostThreads = 16; // a network has a few dozen pipelines
    Task task(std::move(make));
    Pipeline pipeline = task.get_future().share();
    Task own; // of the caller, where there is no thread
    {
        const std::scoped_lock lock(mutex_);
        tasks_.push_back(std::move(task));
        const size_t processors = std::max(1U, std::thread::hardware_concurrency());
        if (threads_.size() < std::min(processors, kMostThreads)) {
            try {
                threads_.emplace_back([this] { work(); });
            } catch (const std::system_error&) {
                // No further thread is to be had: those that are there do it, or the caller.
                if (threads_.empty()) {
                    own = std::move(tasks_.back());
                    tasks_.pop_back();
                }
            }
        }
    }
    if (own.valid()) {
        own();
    }
    changed_.notify_one();
    return pipeline;
}

void CompileQueue::work() {
    for (;;) {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [this] { return ends_ || !tasks_.empty(); });
        if (ends_) {
            return;
        }
        Task task = std::move(tasks_.front());
        tasks_.pop_front();
        lock.unlock();
        task();
    }
}

} // namespace ecir
