#include <pybind11/numpy.h>

#include <memory>
#include <vector>

#include "bindings.h"
#include "infrasim/core/frame.h"

namespace infrasim {

namespace py = pybind11;

namespace {

/// A flat copy of an ObjectRecord. In Python the copy is a NumPy record.
struct ObjectRow {
  std::int32_t id;
  std::uint16_t class_id;
  double x, y, z, dx, dy, dz, heading, speed;
  std::int32_t points, points_in_box;
  double distance, visibility;
  double scan_x, scan_y, scan_z, scan_heading, scan_time_s;
  std::int32_t points_in_scan_box;
};

py::array object_rows(const Frame& frame) {
  py::array_t<ObjectRow> rows(static_cast<py::ssize_t>(frame.objects.size()));
  auto out = rows.mutable_unchecked<1>();
  for (std::size_t i = 0; i < frame.objects.size(); ++i) {
    const ObjectRecord& o = frame.objects[i];
    const Box3d &b = o.box, &s = o.scan_box;
    out(static_cast<py::ssize_t>(i)) = {o.id,          static_cast<std::uint16_t>(o.object_class),
                                        b.x,           b.y,
                                        b.z,           b.dx,
                                        b.dy,          b.dz,
                                        b.heading,     o.speed_m_s,
                                        o.points,      o.points_in_box,
                                        o.distance,    o.visibility,
                                        s.x,           s.y,
                                        s.z,           s.heading,
                                        o.scan_time_s, o.points_in_scan_box};
  }
  return rows;
}

/// Returns a read-only view of a column. The view keeps the frame alive.
template <class T>
py::array_t<T> view(const std::vector<T>& column, std::vector<py::ssize_t> shape,
                    const py::object& owner) {
  py::array_t<T> array(std::move(shape), column.data(), owner);
  array.attr("flags").attr("writeable") = false;
  return array;
}

template <class T>
auto column(std::vector<T> PointCloud::* member) {
  return [member](const py::object& self) {
    const auto& values = self.cast<const Frame&>().cloud.*member;
    return view(values, {static_cast<py::ssize_t>(values.size())}, self);
  };
}

}  // namespace

void bind_frames(py::module_& m) {
  PYBIND11_NUMPY_DTYPE(ObjectRow, id, class_id, x, y, z, dx, dy, dz, heading, speed, points,
                       points_in_box, distance, visibility, scan_x, scan_y, scan_z, scan_heading,
                       scan_time_s, points_in_scan_box);
  py::class_<Frame, std::shared_ptr<Frame>>(
      m, "Frame",
      "The points and objects of one LiDAR in one frame. Columns are read-only "
      "views.")
      .def_property_readonly(
          "xyz",
          [](const py::object& self) {
            const auto& xyz = self.cast<const Frame&>().cloud.xyz;
            return view(xyz, {static_cast<py::ssize_t>(xyz.size() / 3), 3}, self);
          },
          "(n, 3) float32, metres, levelled LiDAR frame.")
      .def_property_readonly("intensity", column(&PointCloud::intensity), "(n,) float32, [0, 1].")
      .def_property_readonly("time", column(&PointCloud::time),
                             "(n,) float32, seconds since the start of the frame.")
      .def_property_readonly("ring", column(&PointCloud::ring),
                             "(n,) uint16, 0 at the lowest elevation.")
      .def_property_readonly("class_id", column(&PointCloud::class_id), "(n,) uint16.")
      .def_property_readonly("object_id", column(&PointCloud::object_id),
                             "(n,) int32, -1 for background.")
      .def_property_readonly("echo", column(&PointCloud::echo),
                             "(n,) uint8, 1 for the second point of a ray, else 0.")
      .def_property_readonly(
          "objects", &object_rows,
          "(k,) structured: every object in range, with its box at mid-frame and its "
          "pose when it was scanned. Levelled LiDAR frame.")
      .def_readonly("rays", &Frame::rays, "Number of rays fired in this frame.")
      .def_readonly("seconds", &Frame::seconds,
                    "Seconds of computation, from the rays to the columns.")
      .def("__len__", [](const Frame& f) { return f.cloud.size(); });
}

}  // namespace infrasim
