#include "infrasim/pipeline/frame_builder.h"

#include <algorithm>
#include <cmath>

namespace infrasim {

void FrameBuilder::start() {
  size_ = 0;
  rays_ = 0;
  hits_.clear();
}

void FrameBuilder::reserve(std::size_t more) {
  if (size_ + more <= scratch_.size()) return;
  scratch_.resize(std::max<std::size_t>(4096, 2 * (size_ + more)));
}

void FrameBuilder::add_hit(const Return& r) {
  const double range = r.hit_range;
  hits_.push_back({size_,
                   rays_,
                   r.object,
                   frozen_s_.value_or(r.time),
                   r.wide,
                   {r.dx * range, r.dy * range, r.dz * range}});
}

void FrameBuilder::keep(std::span<const int> rows) {
  PointCloud::for_each_column([&](auto column, std::size_t values) {
    auto* to = (scratch_.*column).data();
    const auto* from = to;
    for (const int row : rows)
      for (std::size_t v = 0; v < values; ++v)
        *to++ = from[values * static_cast<std::size_t>(row) + v];
  });
  size_ = 0;
  auto hit = hits_.begin(), kept = hits_.begin();
  for (const int row : rows) {
    const auto from = static_cast<std::size_t>(row);
    while (hit != hits_.end() && hit->row < from) ++hit;
    if (hit != hits_.end() && hit->row == from) {
      *kept = *hit;
      (kept++)->row = size_;
    }
    ++size_;
  }
  hits_.erase(kept, hits_.end());
}

PointCloud FrameBuilder::cloud() const {
  PointCloud cloud;
  PointCloud::for_each_column([&](auto column, std::size_t values) {
    const auto& all = scratch_.*column;
    (cloud.*column).assign(all.data(), all.data() + values * size_);
  });
  return cloud;
}

std::vector<std::vector<double>> FrameBuilder::times_seen(std::size_t objects) const {
  std::vector<std::vector<double>> times(objects);
  for (const Hit& hit : hits_) times[static_cast<std::size_t>(hit.object)].push_back(hit.time_s);
  return times;
}

std::vector<PointCount> FrameBuilder::count(std::span<const ObjectBoxes> boxes,
                                            const BoxAt& box_at) const {
  std::vector<std::pair<BoxFrame, BoxFrame>> held;
  for (const ObjectBoxes& b : boxes) held.emplace_back(BoxFrame(b.frame), BoxFrame(b.scan));
  std::vector<PointCount> counts(boxes.size());
  const Hit* before = nullptr;
  for (const Hit& hit : hits_) {
    const bool again = hit.again_after(before);
    before = &hit;
    if (again) continue;
    const auto k = static_cast<std::size_t>(hit.object);
    const auto& [frame, scan] = held[k];
    const Vec3 place =
        hit.wide ? BoxFrame(box_at(k, hit.time_s), frame).nearest(hit.place) : hit.place;
    ++counts[k].points;
    counts[k].points_in_box += frame.contains(place, kBoxMargin);
    counts[k].points_in_scan_box += scan.contains(place, kBoxMargin);
  }
  return counts;
}

std::vector<PointSpread> FrameBuilder::spread(std::size_t objects, const BoxAt& box_at) const {
  struct Ends {
    Vec3 low{kInf, kInf, kInf}, high{-kInf, -kInf, -kInf};
  };
  std::vector<PointSpread> out(objects);
  std::vector<Ends> ends(objects);
  const Hit* before = nullptr;
  for (const Hit& hit : hits_) {
    const bool again = hit.again_after(before);
    before = &hit;
    const auto k = static_cast<std::size_t>(hit.object);
    const BoxFrame box(box_at(k, hit.time_s));
    const Vec3 p = box.to_box(hit.wide ? box.nearest(hit.place) : hit.place);
    auto& [low, high] = ends[k];
    low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
    out[k].points += again ? 0 : 1;
  }
  for (std::size_t k = 0; k < objects; ++k) {
    if (out[k].points == 0) continue;
    const auto& [low, high] = ends[k];
    out[k].along_m = high.x - low.x;
    out[k].across_m = high.y - low.y;
    out[k].up_m = high.z - low.z;
  }
  return out;
}

}  // namespace infrasim
