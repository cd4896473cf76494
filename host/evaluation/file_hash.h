// SHA-256 of files, to say which model and which program made a result.
#pragma once

#include <filesystem>
#include <string>

namespace ivfm::host {

// 64 hexadecimal digits, as sha256sum prints them. Throws std::runtime_error with the path.
std::string sha256_of_file(const std::filesystem::path& path);
std::string sha256_of(const std::string& bytes);

}  // namespace ivfm::host
