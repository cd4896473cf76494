#include "host/radio/radio_proxy.h"

#include <poll.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace ivfm::host {
namespace {

constexpr std::size_t kMaxUdpBytes = 65536;
constexpr int kMaxDatagramsPerTurn = 1000;

}  // namespace

RadioProxy::Client::Client(const PeerAddress& from, const RadioProxyOptions& options,
                           std::uint32_t number)
    : address(from),
      server(options.to),
      up(options.seed + 2 * number, options.faults),
      down(options.seed + 2 * number + 1, options.faults) {}

RadioProxy::RadioProxy(RadioProxyOptions options)
    : options_(std::move(options)),
      clock_(options_.time_scale),
      listener_(options_.listen),
      buffer_(kMaxUdpBytes) {
  const UdpSocket probe(options_.to);
  if (!ok(probe.status())) {
    throw std::runtime_error("--to '" + options_.to + "': " + probe.error_text());
  }
}

void RadioProxy::step(int timeout_ms) {
  wait(timeout_ms);
  const TimeUs now_us = clock_.now_us();
  take_from_robots(now_us);
  for (const auto& client : clients_) {
    take_from_server(*client, now_us);
    deliver(*client, now_us);
  }
}

// Until something comes or is due.
void RadioProxy::wait(int timeout_ms) {
  const TimeUs now_us = clock_.now_us();
  auto wait_us = static_cast<TimeUs>(timeout_ms * 1000.0 * options_.time_scale);
  std::vector<pollfd> waiting{{listener_.fd(), POLLIN, 0}};
  for (const auto& client : clients_) {
    waiting.push_back({client->server.fd(), POLLIN, 0});
    for (const FaultyChannel* channel : {&client->up, &client->down}) {
      const auto arrival_us = channel->next_arrival_us();
      if (arrival_us) wait_us = std::min(wait_us, *arrival_us - std::min(*arrival_us, now_us));
    }
  }
  const double wait_ns = static_cast<double>(wait_us) * 1000.0 / options_.time_scale;
  const timespec timeout{static_cast<std::time_t>(wait_ns / 1e9),
                         static_cast<long>(wait_ns) % 1'000'000'000L};
  ::ppoll(waiting.data(), waiting.size(), &timeout, nullptr);
}

RadioProxy::Client& RadioProxy::client_of(const PeerAddress& from) {
  const auto known = std::find_if(clients_.begin(), clients_.end(),
                                  [&](const auto& client) { return client->address == from; });
  if (known != clients_.end()) return **known;
  if (clients_.size() == kMaxClients) {
    const auto silent = std::min_element(
        clients_.begin(), clients_.end(),
        [](const auto& a, const auto& b) { return a->last_heard_us < b->last_heard_us; });
    forgotten_ += (*silent)->up.counters();
    forgotten_ += (*silent)->down.counters();
    clients_.erase(silent);
  }
  clients_.push_back(std::make_unique<Client>(from, options_, clients_seen_++));
  return *clients_.back();
}

void RadioProxy::take_from_robots(TimeUs now_us) {
  for (int i = 0; i < kMaxDatagramsPerTurn; ++i) {
    const auto datagram = listener_.receive(buffer_);
    if (!datagram) return;
    Client& client = client_of(datagram->second);
    client.last_heard_us = now_us;
    client.up.send(std::span(buffer_).first(datagram->first), now_us);
  }
}

void RadioProxy::take_from_server(Client& client, TimeUs now_us) {
  for (int i = 0; i < kMaxDatagramsPerTurn; ++i) {
    const auto size = client.server.receive(buffer_);
    if (!size.ok()) return;
    client.down.send(std::span(buffer_).first(*size), now_us);
  }
}

// A server that is not there is like a radio that reaches nobody.
void RadioProxy::deliver(Client& client, TimeUs now_us) {
  while (const auto datagram = client.up.receive(now_us)) {
    static_cast<void>(client.server.send(*datagram));
  }
  while (const auto datagram = client.down.receive(now_us)) {
    listener_.send(client.address, *datagram);
  }
}

void RadioProxy::end_faults() {
  options_.faults = {};
  for (const auto& client : clients_) {
    client->up.set_faults({});
    client->down.set_faults({});
  }
}

RadioCounters RadioProxy::counters() const {
  RadioCounters sum = forgotten_;
  for (const auto& client : clients_) {
    sum += client->up.counters();
    sum += client->down.counters();
  }
  return sum;
}

}  // namespace ivfm::host
