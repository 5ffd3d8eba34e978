#pragma once
#include <string>
#include <vector>

#include "layers/operations.hpp"

namespace ecir::cli {

/// The operations in whose names a regular expression is found; all for an empty one. Throws
/// Error(usage) for what is no regular expression, and where it chooses none.
std::vector<const Operation*> choose_operations(const std::string& pattern);

} // namespace ecir::cli
