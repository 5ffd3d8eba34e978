#pragma once
#include <opencv2/core/utils/logger.hpp>

namespace ecir::io {

/// Keeps OpenCV's own log off stderr: what it reports comes back as Error.
inline void silence_opencv() {
    cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
}

} // namespace ecir::io
