#include "infrasim/pipeline/fusion.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "infrasim/core/math.h"
#include "infrasim/pipeline/frame_builder.h"

namespace infrasim {

namespace {

/// Returns the object with the given id in a mount's frame, or null if there is none.
const ObjectRecord* find_object(const Frame& frame, int id) {
  const auto entry = std::ranges::lower_bound(frame.objects, id, {}, &ObjectRecord::id);
  return entry != frame.objects.end() && entry->id == id ? &*entry : nullptr;
}

/// Returns whether a point and the point before it are two echoes of one ray from one object. As in
/// the frames of single mounts, two such points count once.
bool again_after_previous(const FusedFrame& fused, std::size_t i) {
  const PointCloud& c = fused.frame.cloud;
  return i > 0 && c.echo[i] == 1 && c.object_id[i] == c.object_id[i - 1] &&
         c.ring[i] == c.ring[i - 1] && c.time[i] == c.time[i - 1] &&
         fused.mount[i] == fused.mount[i - 1];
}

/// Counts the points inside each object's boxes, with the positions that the points have in the
/// fused frame.
void count_in_boxes(FusedFrame& fused) {
  Frame& frame = fused.frame;
  struct Held {
    ObjectRecord* object;
    BoxFrame frame, scan;
  };
  std::unordered_map<int, Held> by_id;
  for (ObjectRecord& o : frame.objects)
    by_id.emplace(o.id, Held{&o, BoxFrame(o.box), BoxFrame(o.scan_box)});
  const PointCloud& c = frame.cloud;
  for (std::size_t i = 0; i < c.size(); ++i) {
    const auto entry = by_id.find(c.object_id[i]);
    if (entry == by_id.end() || again_after_previous(fused, i)) continue;
    const Vec3 p{c.xyz[3 * i], c.xyz[3 * i + 1], c.xyz[3 * i + 2]};
    const auto& [object, box, scan_box] = entry->second;
    object->points_in_box += box.contains(p, kBoxMargin);
    object->points_in_scan_box += scan_box.contains(p, kBoxMargin);
  }
}

}  // namespace

Fusion::Fusion(const SceneConfig& scene, std::span<const World> worlds, double period_s)
    : first_(worlds.front()), period_s_(period_s) {
  for (const auto& [name, mount] : scene.mounts) mounts_.push_back(mount);
  for (const MountConfig& mount : mounts_) transforms_.push_back(transform_of(mount));
}

/// Returns the transform of a mount's points, which are levelled with the true tilt of the mount.
/// To show the effect of a wrong tilt, the transform removes the true tilt and then applies the
/// assumed tilt.
Fusion::RigidTransform Fusion::transform_of(const MountConfig& mount) const {
  const MountConfig& first = mounts_.front();
  const CalibrationError e = mount.calibration_error.value_or(CalibrationError{});
  Mat3 rotation_to_first = rotation(rad(mount.yaw_deg + e.yaw_deg - first.yaw_deg), 0, 0);
  if (e.pitch_deg != 0 || e.roll_deg != 0)
    rotation_to_first =
        rotation_to_first *
        rotation(0, rad(mount.pitch_deg + e.pitch_deg), rad(mount.roll_deg + e.roll_deg)) *
        rotation(0, 0, -rad(mount.roll_deg)) * rotation(0, -rad(mount.pitch_deg), 0);
  const Vec3 position{mount.x_m + e.x_m, mount.y_m + e.y_m, mount.z_m + e.z_m};
  return {rotation_to_first, first_.level.to_level(position),
          mount.clock_offset_s.value_or(0) - first.clock_offset_s.value_or(0)};
}

MountConfig Fusion::seen_from_first(std::size_t mount) const {
  MountConfig pose = mounts_[mount];
  const Vec3 position = first_.level.to_level(Vec3{pose.x_m, pose.y_m, pose.z_m});
  pose.x_m = position.x;
  pose.y_m = position.y;
  pose.z_m = position.z;
  pose.yaw_deg = deg(wrap_angle(rad(pose.yaw_deg - mounts_.front().yaw_deg)));
  return pose;
}

void Fusion::add_points(const Frame& frame, std::size_t mount, FusedFrame& out) const {
  PointCloud& to = out.frame.cloud;
  const RigidTransform& transform = transforms_[mount];
  const std::size_t first = to.xyz.size();
  PointCloud::for_each_column([&](auto column, std::size_t /*values*/) {
    const auto& more = frame.cloud.*column;
    (to.*column).insert((to.*column).end(), more.begin(), more.end());
  });
  for (float* xyz = to.xyz.data() + first; xyz != to.xyz.data() + to.xyz.size(); xyz += 3) {
    const Vec3 p =
        transform.rotation_to_first * Vec3{xyz[0], xyz[1], xyz[2]} + transform.origin_in_first;
    xyz[0] = static_cast<float>(p.x);
    xyz[1] = static_cast<float>(p.y);
    xyz[2] = static_cast<float>(p.z);
  }
  out.mount.resize(to.size(), static_cast<std::uint16_t>(mount));
}

ObjectRecord Fusion::record(const MovingObject& o, std::span<const Frame* const> frames) const {
  const Box3d middle = o.at(0.5);
  ObjectRecord out;
  out.id = o.id;
  out.object_class = o.object_class;
  out.box = first_.level.to_level(middle);
  out.speed_m_s = o.speed_m_s;
  out.distance = math::hypot(out.box.x, out.box.y);
  const bool inside = first_.region.contains({middle.x, middle.y}, o.object_class);
  double time_s = 0;
  for (std::size_t m = 0; m < frames.size(); ++m) {
    const ObjectRecord* seen = find_object(*frames[m], o.id);
    if (seen == nullptr) continue;
    if (inside) out.visibility = std::max(out.visibility, seen->visibility);
    out.points += seen->points;
    time_s += seen->points * (seen->scan_time_s + transforms_[m].late_s);
  }
  out.scan_time_s = out.points > 0 ? time_s / out.points : period_s_ / 2;
  out.scan_box = first_.level.to_level(o.at(out.scan_time_s / period_s_));
  return out;
}

FusedFrame Fusion::fuse(int k, std::span<const Frame* const> frames) const {
  FusedFrame out;
  Frame& whole = out.frame;
  for (std::size_t m = 0; m < frames.size(); ++m) {
    add_points(*frames[m], m, out);
    whole.rays += frames[m]->rays;
    whole.rays_cast += frames[m]->rays_cast;
    whole.no_plane |= frames[m]->no_plane;
    whole.pitched |= frames[m]->pitched;
    whole.seconds += frames[m]->seconds;
  }
  for (const MovingObject& o : first_.objects_in_frame(k, period_s_))
    if (std::ranges::any_of(frames, [&](const Frame* f) { return find_object(*f, o.id); }))
      whole.objects.push_back(record(o, frames));
  count_in_boxes(out);
  return out;
}

}  // namespace infrasim
