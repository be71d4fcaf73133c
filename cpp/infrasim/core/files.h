#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

namespace infrasim {

/// Returns whether a path contains a zero byte. System calls would cut off the path at this byte.
inline bool has_zero(const std::filesystem::path& file) {
  return file.native().find('\0') != std::string::npos;
}

/// maximum size, in bytes, of a file that is read into memory
inline constexpr std::uintmax_t kMostBytes = std::uintmax_t{4} << 30;

/// Refuses FIFOs, devices and sockets. A read from one of them may never end, and a rename would
/// replace it. A file that does not exist is accepted.
/// @throws ConfigError if the path leads to a FIFO, a device or a socket
void expect_regular(const std::filesystem::path& file);

/// Opens a file to read its bytes.
/// @throws IoError if it can't be read, ConfigError if it is a FIFO, a device or a socket
std::ifstream open_file(const std::filesystem::path& file);

/// Returns all bytes of a file.
/// @throws IoError if the file can't be read, ConfigError if it is not a regular file or has more
///   than `most` bytes
std::string read_file(const std::filesystem::path& file, std::uintmax_t most = kMostBytes);

/// The bytes of a byte-order mark, with which some editors begin a UTF-8 file.
inline constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";

/// Returns a text without a byte-order mark, and with lines that end in \n instead of \r\n.
std::string unix_text(std::string text);

/// Returns the paths of the entries of a folder. If an error occurs, the function sets `error` and
/// returns the entries that were listed before the error. A range-based loop over a
/// std::filesystem::directory_iterator would throw a filesystem_error, which is not an error of
/// this program.
std::vector<std::filesystem::path> entries_of(const std::filesystem::path& folder,
                                              std::error_code& error);

/// Starts to record which files this process opens to read. A command calls this function at its
/// start, so that the command's output does not replace an input.
void record_read_files();

/// Returns whether the path leads to a file that was opened to read after the call of
/// record_read_files().
bool was_read(const std::filesystem::path& file);

}  // namespace infrasim
