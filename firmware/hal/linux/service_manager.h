// Tells the service manager (systemd) how the agent is: sd_notify(3)'s datagrams, without its
// library.
#pragma once

#include <sys/socket.h>
#include <sys/un.h>

#include <string_view>

#include "firmware/hal/clock.h"

namespace ivfm {

// Silent when nobody started us that wants to hear. No heap.
class ServiceManager {
 public:
  static constexpr TimeUs kAlivePeriodUs = 100'000;

  // `socket`: value of NOTIFY_SOCKET, a path or, with '@' in front, an abstract name; may be null.
  explicit ServiceManager(const char* socket);
  ~ServiceManager();
  ServiceManager(const ServiceManager&) = delete;
  ServiceManager& operator=(const ServiceManager&) = delete;

  // Somebody listens.
  bool connected() const { return fd_ >= 0; }
  void ready() { send("READY=1"); }
  void stopping() { send("STOPPING=1"); }
  // To be called in every turn of the main loop; sends a sign of life once a period.
  void alive(TimeUs now_us);

 private:
  void send(std::string_view state);

  int fd_ = -1;
  sockaddr_un address_{};
  socklen_t address_size_ = 0;
  TimeUs next_us_ = 0;
};

}  // namespace ivfm
