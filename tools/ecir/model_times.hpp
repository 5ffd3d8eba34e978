#pragma once
#include <map>
#include <memory>
#include <string>

#include "runtime/device.hpp"
#include "tools/ecir/bench_models.hpp"

namespace ecir::cli {

/// How long models take on a device for a blurry frame whose whole image moves: measured once and
/// kept in the cache folder, where there is one.
class ModelTimes {
public:
    explicit ModelTimes(std::shared_ptr<Device> device);

    /// Milliseconds from the frame and 100,000 events in host memory to sharp frames there, kernels
    /// compiled. Errors as for Deblur.
    double ms(const ModelCase& work);

private:
    std::shared_ptr<Device> device_;
    std::string file_;
    std::map<std::string, double> known_;
};

/// The largest of the models that `auto` chooses from which stays within a budget of milliseconds
/// for a blurry frame, or, where none does, the smallest.
struct BudgetChoice {
    std::string model;
    double ms = 0; ///< what it takes
};
BudgetChoice choose_within(double budget_ms, const std::shared_ptr<Device>& device,
                           const PixelSize& size, uint32_t frames);

} // namespace ecir::cli
