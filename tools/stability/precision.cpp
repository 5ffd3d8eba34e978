#include "tools/stability/sweep.hpp"
namespace ecir::stability {
std::vector<Sweep> precision_sweeps() {
    return {};
}
} // namespace ecir::stability
