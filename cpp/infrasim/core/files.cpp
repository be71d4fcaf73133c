#include "infrasim/core/files.h"

#include <fstream>
#include <sstream>

#include "infrasim/core/errors.h"

namespace infrasim {

std::ifstream open_file(const std::filesystem::path& file) {
  if (has_zero(file)) throw IoError("(file): expected a path without a zero byte, got one with it");
  std::ifstream in(file, std::ios::binary);
  if (!in.is_open() || std::filesystem::is_directory(file))
    throw IoError(file.string() + ": can't be read");
  return in;
}

std::string read_file(const std::filesystem::path& file) {
  std::ifstream in = open_file(file);
  std::ostringstream bytes;
  // Reading an empty file would set the stream's fail bit.
  if (in && in.peek() != std::ifstream::traits_type::eof()) bytes << in.rdbuf();
  // An error while the bytes are copied sets a bit of `bytes`, not of `in`.
  if (in.bad() || !bytes) throw IoError(file.string() + ": can't be read");
  return bytes.str();
}

}  // namespace infrasim
