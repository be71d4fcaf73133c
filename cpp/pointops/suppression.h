#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace pointops {

/// Selects boxes by greedy non-maximum suppression, with the IoU of rotated footprints.
/// @param boxes  7 * n, x y z dx dy dz heading, by decreasing score, finite
/// @param iou    a box is removed if its IoU with a kept box is larger than this value
/// @param limit  maximum number of boxes to keep
/// @return rows of the kept boxes, increasing
/// @throws std::invalid_argument if a box is not finite, iou is NaN or the limit is negative
std::vector<std::int64_t> suppress(std::span<const double> boxes, double iou, std::int64_t limit);

}  // namespace pointops
