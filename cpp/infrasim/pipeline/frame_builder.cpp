#include "infrasim/pipeline/frame_builder.h"

#include <algorithm>
#include <cmath>

namespace infrasim {

namespace {

template <class T>
void copy_head(const std::vector<T>& from, std::vector<T>& to, std::size_t n) {
  to.assign(from.begin(), from.begin() + static_cast<std::ptrdiff_t>(n));
}

}  // namespace

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
  size_ = 0;
  auto hit = hits_.begin(), kept = hits_.begin();
  for (const int row : rows) {
    const auto from = static_cast<std::size_t>(row);
    std::copy_n(&scratch_.xyz[3 * from], 3, &scratch_.xyz[3 * size_]);
    scratch_.intensity[size_] = scratch_.intensity[from];
    scratch_.time[size_] = scratch_.time[from];
    scratch_.ring[size_] = scratch_.ring[from];
    scratch_.class_id[size_] = scratch_.class_id[from];
    scratch_.object_id[size_] = scratch_.object_id[from];
    scratch_.echo[size_] = scratch_.echo[from];
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
  copy_head(scratch_.xyz, cloud.xyz, 3 * size_);
  copy_head(scratch_.intensity, cloud.intensity, size_);
  copy_head(scratch_.time, cloud.time, size_);
  copy_head(scratch_.ring, cloud.ring, size_);
  copy_head(scratch_.class_id, cloud.class_id, size_);
  copy_head(scratch_.object_id, cloud.object_id, size_);
  copy_head(scratch_.echo, cloud.echo, size_);
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
