#include "infrasim/cli/output_file.h"

#include <string>

#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"

namespace infrasim::cli {

void refuse_input(const char* option, const std::filesystem::path& file) {
  if (was_read(file))
    throw ConfigError(std::string(option) + ": expected another file than the inputs, got " +
                      file.string());
}

}  // namespace infrasim::cli
