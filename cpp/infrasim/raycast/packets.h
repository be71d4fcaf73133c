#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "infrasim/core/rays.h"
#include "infrasim/raycast/view_bounds.h"

namespace infrasim {

/// Number of rays that are cast together. Another number would change the last digits of results.
inline constexpr std::size_t kPacketRays = 16;

/// Returns the numbers of the rays in packet number `packet`. `order` has the numbers of all rays.
inline std::span<const std::uint32_t> packet_of(std::span<const std::uint32_t> order,
                                                std::size_t packet) {
  const std::size_t first = packet * kPacketRays;
  return order.subspan(first, std::min(kPacketRays, order.size() - first));
}

/// Calls `work` with the numbers of the rays in each packet. `order` has the numbers of all rays.
template <class Work>
void for_each_packet(std::span<const std::uint32_t> order, const Work& work) {
  for (std::size_t first = 0; first < order.size(); first += kPacketRays)
    work(order.subspan(first, std::min(kPacketRays, order.size() - first)));
}

/// Returns the view that contains the rays with the given numbers.
inline ViewBounds view_of(const RayBatch& rays, std::span<const std::uint32_t> packet) {
  ViewBounds view;
  for (const std::uint32_t k : packet) view.add(rays.dx[k], rays.dy[k], rays.dz[k]);
  return view;
}

}  // namespace infrasim
