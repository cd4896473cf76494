#include "firmware/hal/linux/service_manager.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstddef>
#include <cstring>
#include <string>
#include <vector>

namespace ivfm {
namespace {

// What systemd does: a datagram socket whose name is in the environment.
class Listener {
 public:
  explicit Listener(const std::string& name) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, name.data(), name.size());
    if (name[0] == '@') address.sun_path[0] = '\0';
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size());
    fd_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    EXPECT_EQ(::bind(fd_, reinterpret_cast<const sockaddr*>(&address), size), 0);
  }
  ~Listener() { ::close(fd_); }

  std::vector<std::string> heard() const {
    std::vector<std::string> all;
    char text[256];
    for (ssize_t size; (size = ::read(fd_, text, sizeof text)) > 0;) {
      all.emplace_back(text, static_cast<std::size_t>(size));
    }
    return all;
  }

 private:
  int fd_;
};

using Texts = std::vector<std::string>;

TEST(ServiceManager, HearsThatTheAgentIsReadyAliveAndStopping) {
  const std::string path = "/tmp/ivfm-notify-" + std::to_string(::getpid());
  {
    const Listener listener(path);
    ServiceManager manager(path.c_str());
    EXPECT_TRUE(manager.connected());
    manager.ready();
    manager.stopping();
    EXPECT_EQ(listener.heard(), (Texts{"READY=1", "STOPPING=1"}));
  }
  ::unlink(path.c_str());
}

TEST(ServiceManager, HearsASignOfLifeOnceAPeriod) {
  const std::string name = "@ivfm-notify-" + std::to_string(::getpid());
  const Listener listener(name);
  ServiceManager manager(name.c_str());
  for (TimeUs now_us = 1'000; now_us < 251'000; now_us += 10'000) manager.alive(now_us);
  EXPECT_EQ(listener.heard(), Texts(3, "WATCHDOG=1"));
}

TEST(ServiceManager, WithoutOneNothingHappens) {
  const std::string too_long = "/" + std::string(200, 'x');
  for (const char* name : {static_cast<const char*>(nullptr), "", "relative", too_long.c_str()}) {
    ServiceManager manager(name);
    EXPECT_FALSE(manager.connected());
    manager.ready();
    manager.alive(1);
  }
  ServiceManager gone("/nowhere/notify");
  gone.ready();
}

}  // namespace
}  // namespace ivfm
