#include "firmware/hal/linux/radio_key_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstring>
#include <stdexcept>

namespace ivfm {
namespace {

// 65,535 robots' lines.
constexpr std::size_t kMaxFileBytes = std::size_t{65535} * 80;

[[noreturn]] void fail(const std::string& what) { throw std::runtime_error(what); }

class File {
 public:
  File(const std::string& path, int flags, mode_t mode = 0)
      : fd_(::open(path.c_str(), flags | O_CLOEXEC, mode)) {}
  ~File() {
    if (fd_ >= 0) ::close(fd_);
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  int fd() const { return fd_; }

 private:
  int fd_;
};

int digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

bool parse_key(std::string_view text, RadioKey& key) {
  if (text.size() != 2 * key.size()) return false;
  for (std::size_t i = 0; i < key.size(); ++i) {
    const int high = digit(text[2 * i]), low = digit(text[2 * i + 1]);
    if (high < 0 || low < 0) return false;
    key[i] = static_cast<std::uint8_t>(high * 16 + low);
  }
  return true;
}

bool parse_line(std::string_view line, RadioKeys& keys) {
  std::uint16_t robot = 0;
  const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), robot);
  const auto rest = line.substr(static_cast<std::size_t>(end - line.data()));
  RadioKey key;
  if (error != std::errc() || robot == 0 || rest.empty() || rest.front() != ' ') return false;
  return parse_key(rest.substr(1), key) && keys.emplace(robot, key).second;
}

// The name of the file while it is written; gone again unless it was renamed.
struct Unfinished {
  std::string path;
  ~Unfinished() { ::unlink(path.c_str()); }
};

}  // namespace

RadioKeys parse_radio_keys(std::string_view text, const std::string& file_name) {
  RadioKeys keys;
  for (int number = 1; !text.empty(); ++number) {
    const std::size_t size = std::min(text.find('\n'), text.size());
    std::string_view line = text.substr(0, size);
    text.remove_prefix(std::min(size + 1, text.size()));
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (line.empty() || line.front() == '#' || parse_line(line, keys)) continue;
    fail(file_name + ":" + std::to_string(number) +
         ": not a robot's number, new in this file, a space and 64 hexadecimal digits; "
         "ivfm keygen writes such files");
  }
  if (keys.empty()) fail(file_name + " holds no radio key; ivfm keygen writes such files");
  return keys;
}

RadioKeys read_radio_keys(const std::string& path) {
  const File file(path, O_RDONLY);
  struct stat about {};
  if (file.fd() < 0 || ::fstat(file.fd(), &about) != 0) {
    fail("cannot read the radio keys " + path + ": " + std::strerror(errno));
  }
  if (!S_ISREG(about.st_mode)) fail("the radio keys " + path + " are no file");
  if ((about.st_mode & 077) != 0) {
    fail("others have access to the radio keys " + path + "; make it yours alone: chmod 600 " +
         path);
  }
  if (about.st_size > static_cast<off_t>(kMaxFileBytes))
    fail(path + " is too large for radio keys");
  std::string text(static_cast<std::size_t>(about.st_size), '\0');
  const ssize_t size = ::read(file.fd(), text.data(), text.size());
  if (size < 0) fail("cannot read the radio keys " + path + ": " + std::strerror(errno));
  text.resize(static_cast<std::size_t>(size));
  return parse_radio_keys(text, path);
}

std::string format_radio_keys(const RadioKeys& keys) {
  std::string text = "# ivfm radio keys: robot and key. Secret: the file has mode 600.\n";
  for (const auto& [robot, key] : keys) {
    text += std::to_string(robot) + ' ';
    for (const std::uint8_t byte : key) {
      text += "0123456789abcdef"[byte >> 4];
      text += "0123456789abcdef"[byte & 15];
    }
    text += '\n';
  }
  return text;
}

void write_radio_keys(const std::string& path, const RadioKeys& keys) {
  const std::string text = format_radio_keys(keys);
  const Unfinished part{path + ".part"};
  ::unlink(part.path.c_str());
  const File file(part.path, O_WRONLY | O_CREAT | O_EXCL, 0600);
  const bool written =
      file.fd() >= 0 &&
      ::write(file.fd(), text.data(), text.size()) == static_cast<ssize_t>(text.size()) &&
      ::fsync(file.fd()) == 0;
  if (!written || ::rename(part.path.c_str(), path.c_str()) != 0) {
    fail("cannot write the radio keys " + path + ": " + std::strerror(errno));
  }
}

}  // namespace ivfm
