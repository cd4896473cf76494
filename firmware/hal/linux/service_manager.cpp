#include "firmware/hal/linux/service_manager.h"

#include <unistd.h>

#include <algorithm>
#include <cstddef>

namespace ivfm {

ServiceManager::ServiceManager(const char* socket) {
  const std::string_view name = socket != nullptr ? socket : "";
  const bool usable = !name.empty() && (name[0] == '/' || name[0] == '@');
  if (!usable || name.size() >= sizeof address_.sun_path) return;
  address_.sun_family = AF_UNIX;
  std::copy(name.begin(), name.end(), address_.sun_path);
  if (name[0] == '@') address_.sun_path[0] = '\0';
  address_size_ = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size());
  fd_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
}

ServiceManager::~ServiceManager() {
  if (fd_ >= 0) ::close(fd_);
}

void ServiceManager::alive(TimeUs now_us) {
  if (now_us < next_us_) return;
  next_us_ = now_us + kAlivePeriodUs;
  send("WATCHDOG=1");
}

// A manager that does not listen any more is none of the robot's business.
void ServiceManager::send(std::string_view state) {
  if (fd_ < 0) return;
  (void)::sendto(fd_, state.data(), state.size(), MSG_NOSIGNAL,
                 reinterpret_cast<const sockaddr*>(&address_), address_size_);
}

}  // namespace ivfm
