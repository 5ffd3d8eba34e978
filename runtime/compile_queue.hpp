#pragma once
#include <condition_variable>
#include <deque>
#include <functional>
#include <future>
#include <mutex>
#include <thread>
#include <vector>

#include "runtime/vk.hpp"

namespace ecir {

/// Makes pipelines on threads of its own, a processor each: drivers compile one on the thread that
/// asks for it, and a network needs dozens.
class CompileQueue {
public:
    using Pipeline = std::shared_future<Handle<VkPipeline>>;

    CompileQueue() = default;
    /// Waits for what is being made; what nobody has begun is dropped.
    ~CompileQueue();
    CompileQueue(const CompileQueue&) = delete;
    CompileQueue& operator=(const CompileQueue&) = delete;

    /// `make` is called once, on another thread; what it throws, the result's get() throws.
    Pipeline add(std::function<Handle<VkPipeline>()> make);

private:
    using Task = std::packaged_task<Handle<VkPipeline>()>;
    void work();

    std::mutex mutex_;
    std::condition_variable changed_;
    std::deque<Task> tasks_;
    bool ends_ = false;
    std::vector<std::thread> threads_;
};

} // namespace ecir
