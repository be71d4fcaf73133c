#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <span>
#include <stdexcept>
#include <utility>

#include "bindings.h"
#include "pointops/ball_query.h"
#include "pointops/farthest_points.h"
#include "pointops/pillars.h"
#include "pointops/suppression.h"
#include "pointops/voxel_pairs.h"

namespace infrasim {

namespace py = pybind11;

namespace {

template <typename T>
using Array = py::array_t<T, py::array::c_style>;

template <typename T>
void check_aligned(const Array<T>& array, const char* name) {
  if (reinterpret_cast<std::uintptr_t>(array.data()) % alignof(T) != 0)
    throw std::invalid_argument(std::string(name) +
                                ": expected aligned numbers, got an unaligned array");
}

/// Returns the row-major values of an array with shape (n) or (n, columns).
template <typename T>
std::span<const T> values_of(const Array<T>& array, const char* name, py::ssize_t columns = 0) {
  const bool fits =
      columns == 0 ? array.ndim() == 1 : array.ndim() == 2 && array.shape(1) == columns;
  if (!fits)
    throw std::invalid_argument(std::string(name) + ": expected shape (n" +
                                (columns == 0 ? ")" : ", " + std::to_string(columns) + ")") +
                                ", got " + py::str(array.attr("shape")).cast<std::string>());
  check_aligned(array, name);
  return {array.data(), static_cast<std::size_t>(array.size())};
}

/// Returns an array that owns the values, without copying them.
template <typename T>
Array<T> moved(std::vector<T>&& values, std::vector<py::ssize_t> shape) {
  auto* owned = new std::vector<T>(std::move(values));
  const py::capsule owner(owned, [](void* p) { delete static_cast<std::vector<T>*>(p); });
  return Array<T>(std::move(shape), owned->data(), owner);
}

template <typename T>
Array<T> moved(std::vector<T>&& values) {
  const auto n = static_cast<py::ssize_t>(values.size());
  return moved(std::move(values), {n});
}

Array<std::int64_t> farthest_points(const Array<float>& xyz, std::int64_t count) {
  const auto points = values_of(xyz, "xyz", 3);
  return moved(without_lock([&] { return pointops::farthest_points(points, count); }));
}

std::pair<Array<std::int64_t>, Array<std::uint8_t>> ball_query(const Array<float>& points,
                                                               const Array<float>& centres,
                                                               float radius, std::int64_t limit) {
  const auto all = values_of(points, "points", 3), around = values_of(centres, "centres", 3);
  pointops::Balls balls =
      without_lock([&] { return pointops::ball_query(all, around, radius, limit); });
  return {moved(std::move(balls.rows), {centres.shape(0), limit}), moved(std::move(balls.empty))};
}

using Pairs = std::tuple<Array<std::int64_t>, Array<std::int64_t>, std::vector<std::int64_t>>;

Pairs moved(pointops::VoxelPairs&& pairs) {
  return {moved(std::move(pairs.inputs)), moved(std::move(pairs.outputs)), pairs.counts};
}

Pairs shifted_pairs(const Array<std::int64_t>& keys, const std::vector<std::int64_t>& steps) {
  const auto values = values_of(keys, "keys");
  return moved(without_lock([&] { return pointops::shifted_pairs(values, steps); }));
}

using Triple = std::array<std::int64_t, 3>;

std::pair<Pairs, Array<std::int64_t>> reached_voxels(const Array<std::int64_t>& coordinates,
                                                     Triple shape, Triple kernel, Triple stride,
                                                     Triple padding, Triple target_shape) {
  const auto voxels = values_of(coordinates, "coordinates", 4);
  pointops::ReachedVoxels reached = without_lock([&] {
    return pointops::reached_voxels(voxels, {.shape = shape,
                                             .kernel = kernel,
                                             .stride = stride,
                                             .padding = padding,
                                             .target_shape = target_shape});
  });
  return {moved(std::move(reached.pairs)), moved(std::move(reached.keys))};
}

Array<std::int64_t> suppress(const Array<double>& boxes, double iou, std::int64_t limit) {
  const auto values = values_of(boxes, "boxes", 7);
  return moved(without_lock([&] { return pointops::suppress(values, iou, limit); }));
}

constexpr std::int64_t kMostStride = 16;

void pillar_map(const Array<float>& points, std::pair<float, float> low, float middle_z, float side,
                const Array<float>& weight, const Array<float>& bias, std::int64_t first,
                const Array<float>& layer_weight, const Array<float>& layer_bias,
                std::int64_t stride, Array<float>& map) {
  check_aligned(map, "map");
  if (points.ndim() != 2 || map.ndim() != 3 || stride < 1 || stride > kMostStride)
    throw std::invalid_argument(
        "points, map, stride: expected shapes (n, columns) and (outputs, rows, columns) and a "
        "stride of 1 to 16, got different shapes or a different stride");
  const pointops::PillarGrid grid{.low_x = low.first,
                                  .low_y = low.second,
                                  .middle_z = middle_z,
                                  .side = side,
                                  .rows = map.shape(1) * stride,
                                  .columns = map.shape(2) * stride};
  const pointops::PillarLayer encoder{.weight = values_of(weight, "weight", bias.size()),
                                      .bias = values_of(bias, "bias"),
                                      .first = first};
  const auto outputs = layer_bias.size();
  const pointops::CanvasLayer layer{.weight = values_of(layer_weight, "layer_weight", outputs),
                                    .bias = values_of(layer_bias, "layer_bias"),
                                    .stride = stride};
  const auto values = values_of(points, "points", points.shape(1));
  const std::int64_t columns = points.shape(1);
  const std::span<float> cells{map.mutable_data(), static_cast<std::size_t>(map.size())};
  const py::gil_scoped_release release;
  pointops::pillar_map(values, columns, grid, encoder, layer, cells);
}

}  // namespace

void bind_pointops(py::module_& m) {
  m.def("farthest_points", &farthest_points, py::arg("xyz").noconvert(), py::arg("count"),
        "Farthest point sampling: returns (count,) int64 rows of xyz, starting with "
        "row 0. xyz: (n, 3) float32. Raises ValueError if there are no points or a "
        "value is not finite.");
  m.def("ball_query", &ball_query, py::arg("points").noconvert(), py::arg("centres").noconvert(),
        py::arg("radius"), py::arg("limit"),
        "Returns (m, limit) int64, the first rows of points closer than radius to "
        "each centre, and (m,) uint8, 1 for a centre without such points. Unused "
        "entries repeat the first row. points: (n, 3) float32. centres: (m, 3) "
        "float32.");
  m.def("shifted_pairs", &shifted_pairs, py::arg("keys").noconvert(), py::arg("steps"),
        "Returns inputs (p,) int64, outputs (p,) int64 and the number of pairs for "
        "each step: rows with keys[input] = keys[output] + step. keys: (n,) int64, "
        "increasing.");
  m.def("reached_voxels", &reached_voxels, py::arg("coordinates").noconvert(), py::arg("shape"),
        py::arg("kernel"), py::arg("stride"), py::arg("padding"), py::arg("target_shape"),
        "Returns (inputs, outputs, counts), as shifted_pairs does, for each offset of "
        "the kernel, and the increasing keys (m,) int64 of the output voxels of a "
        "convolution. coordinates: (n, 4) int64, batch z y x within the shape.");
  m.def("suppress", &suppress, py::arg("boxes").noconvert(), py::arg("iou"), py::arg("limit"),
        "Non-maximum suppression: returns (k,) int64, increasing, k <= limit: the "
        "rows of boxes that no kept better box overlaps by more than iou. boxes: (n, "
        "7) float64, best first.");
  m.def("pillar_map", &pillar_map, py::arg("points").noconvert(), py::arg("low"),
        py::arg("middle_z"), py::arg("side"), py::arg("weight").noconvert(),
        py::arg("bias").noconvert(), py::arg("first"), py::arg("layer_weight").noconvert(),
        py::arg("layer_bias").noconvert(), py::arg("stride"), py::arg("map").noconvert(),
        "Overwrites map (outputs, rows, columns) float32 with the first convolution on the pillars "
        "of a cloud. points: (n, 3 or more) float32. low, side: x, y of the grid's corner, side of "
        "a cell. weight: (inputs, features), bias: (features,) of the linear layer of a point. "
        "first: number of inputs that are left out. layer_weight: (9 * features, outputs), "
        "layer_bias: (outputs,) of a 3 x 3 convolution.");
}

}  // namespace infrasim
