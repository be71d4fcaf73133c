#include <cstddef>
#include <cstdint>
#include <string>

#include "fuzz_folder.h"
#include "infrasim/scene/trajectories.h"
#include "infrasim/scene/trajectory_text.h"

// Input: the text of a trajectories.csv, whole, below its header, or below its first row. It is
// read or refused with a ConfigError; what was read is written to a text that reads back to itself.

namespace {

using namespace infrasim;

void read(const std::string& text) {
  static const fuzz::Folder folder;
  const auto file = folder.write("trajectories.csv", text);
  Trajectories trajectories;
  if (!fuzz::is_done([&] { trajectories = read_trajectories(file); })) return;
  for (int k = 0; k < std::min(trajectories.steps(), 100); ++k)
    for (const MovingObject& o : trajectories.between(k, k + 1))
      fuzz::require(std::abs(o.at(0.5).x) <= 1e7);
  const std::string written = trajectories_csv(trajectories);
  fuzz::require(trajectories_csv(read_trajectories(folder.write("again.csv", written))) == written);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string input(reinterpret_cast<const char*>(data), size);
  const std::string header = "t,id,class,x,y,z,heading,dx,dy,dz,speed\n";
  read(input);
  read(header + input);
  read(header + "0,1,Car,0,0,0.8,0,4,2,1.6,10\n0.1,1,Car,1,0,0.8,0,4,2,1.6,10\n" + input);
  return 0;
}
