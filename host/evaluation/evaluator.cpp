#include "host/evaluation/evaluator.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <utility>

#include "host/environment/random.h"
#include "host/evaluation/file_hash.h"
#include "host/evaluation/policies/exploration_policy.h"
#include "host/evaluation/wire_meter.h"

namespace ivfm::host {

namespace {

// The seed of one episode, and of what its policy draws.
std::uint64_t episode_seed(std::uint64_t seed, int episode) {
  return Random(seed, static_cast<std::uint64_t>(episode)).next();
}

// What the workers of this process share.
struct Shift {
  std::vector<int> todo;  // numbers of episodes
  std::atomic<std::size_t> next{0};
  std::mutex mutex;  // for all below
  std::condition_variable changed;
  std::vector<EpisodeRecord> finished;
  int working = 0;  // threads
  std::exception_ptr error;
};

void work(const EvaluationRequest& request, Shift& shift) {
  std::exception_ptr error;
  try {
    ExplorationEnvironment env(request.world.config);
    const auto policy = make_policy(request.policy, request.world.config, request.model);
    for (std::size_t i = shift.next++; i < shift.todo.size(); i = shift.next++) {
      const EpisodeRecord record = play_episode(request, env, *policy, shift.todo[i]);
      const std::lock_guard lock(shift.mutex);
      shift.finished.push_back(record);
      shift.changed.notify_one();
    }
  } catch (...) {
    error = std::current_exception();
    shift.next = shift.todo.size();
  }
  const std::lock_guard lock(shift.mutex);
  if (!shift.error) shift.error = error;
  --shift.working;
  shift.changed.notify_one();
}

// Waits a moment for finished episodes and takes them. `is_over`: no thread works any more.
std::vector<EpisodeRecord> take_finished(Shift& shift, bool& is_over) {
  std::unique_lock lock(shift.mutex);
  shift.changed.wait_for(lock, std::chrono::milliseconds(10));
  if (shift.error) {
    shift.next = shift.todo.size();
    std::rethrow_exception(shift.error);
  }
  is_over = shift.working == 0;
  return std::exchange(shift.finished, {});
}

// The episodes that this process has to play.
std::vector<int> share_of(const ProcessGroup& group, const EpisodeStore::Episodes& known,
                          int episodes) {
  std::vector<int> share;
  for (int i = group.rank(); i < episodes; i += group.size()) {
    if (!known.contains(i)) share.push_back(i);
  }
  return share;
}

EvaluationResult result_of(const EpisodeStore::Episodes& played, int episodes) {
  EvaluationResult result;
  for (const auto& [number, record] : played) {
    if (number >= episodes) break;
    result.episodes.push_back(record.metrics);
    result.decisions += record.decisions;
    result.busy_s += record.busy_s;
  }
  return result;
}

}  // namespace

std::string key_of(const EvaluationRequest& request) {
  static const std::string program = sha256_of_file("/proc/self/exe").substr(0, 12);
  std::string key = program + ' ' + request.world.identity + ' ' + request.policy;
  if (!request.model.empty()) key += '@' + sha256_of_file(request.model).substr(0, 12);
  key += ' ' + request.state + " agents=" + std::to_string(request.agents) +
         " seed=" + std::to_string(request.seed);
  std::ranges::replace_if(
      key, [](char c) { return c == ',' || c == '\n' || c == '\r'; }, '_');
  return key;
}

EpisodeRecord play_episode(const EvaluationRequest& request, ExplorationEnvironment& env,
                           ExplorationPolicy& policy, int episode, const ActionObserver& observe) {
  const auto started = std::chrono::steady_clock::now();
  const std::uint64_t seed = episode_seed(request.seed, episode);
  WireMeter meter(env);
  env.reset(request.world.scenario(request.agents, seed));
  policy.start_episode(Random(seed, 1).next());
  const int state_channels = request.state == "vfm" ? 4 : 2;
  MeasuresOfEveryPlace of_every_place;
  std::int64_t decisions = 0;
  std::vector<std::int64_t> sim_steps(static_cast<std::size_t>(env.agents()), 0);
  std::array<std::optional<double>, kMilestones.size()> reached{};
  while (!env.is_done()) {
    const int agent = env.next_agent();
    const StepResult result = policy.act(env, agent);
    sim_steps[static_cast<std::size_t>(agent)] += result.sim_steps;
    ++decisions;
    meter.note_action(result.sim_steps);
    if (observe) observe(env, agent, result);
    if (result.places > 0) {
      of_every_place.add(measured(env, sim_steps, state_channels), result.places);
    }
    for (std::size_t i = 0; i < reached.size(); ++i) {
      if (reached[i] || env.totals().coverage() < kMilestones[i]) continue;
      reached[i] = env.totals().total_distance_m();
    }
  }
  const auto wire_bytes = static_cast<double>(meter.finish());
  EpisodeMetrics metrics;
  if (const auto& places = env.scenario().places; places.empty()) {
    metrics = measured(env, sim_steps, state_channels);
    metrics.milestone_m = reached;
    metrics.wire_bytes = wire_bytes;
  } else {
    metrics = of_every_place.mean(static_cast<int>(places.size()));
  }
  metrics.seed = seed;
  const std::chrono::duration<double> busy = std::chrono::steady_clock::now() - started;
  return {episode, metrics, decisions, busy.count()};
}

EvaluationResult evaluate(const EvaluationRequest& request, EpisodeStore& store,
                          ProcessGroup& group, const std::function<void(int)>& progress) {
  if (request.episodes < 1) throw std::invalid_argument("--episodes must be at least 1");
  const std::string key = key_of(request);
  Shift shift;
  shift.todo = share_of(group, store.episodes(key), request.episodes);
  shift.working = request.threads;
  std::vector<std::jthread> threads;
  for (int i = 0; i < request.threads; ++i) threads.emplace_back([&] { work(request, shift); });
  for (bool is_over = false; !is_over;) {
    for (const EpisodeRecord& record : take_finished(shift, is_over)) {
      const std::string line = to_line(key, record);
      if (group.is_first()) {
        store.add(line);
      } else {
        group.send_to_first(line);
      }
    }
    if (!group.is_first()) continue;
    while (const auto line = group.receive()) store.add(*line);
    const int finished = store.count(key, request.episodes);
    is_over = finished == request.episodes;
    if (progress) progress(finished);
  }
  return group.is_first() ? result_of(store.episodes(key), request.episodes) : EvaluationResult();
}

EvaluationResult evaluate(const EvaluationRequest& request,
                          const std::function<void(int)>& progress) {
  EpisodeStore store;
  ProcessGroup alone;
  return evaluate(request, store, alone, progress);
}

}  // namespace ivfm::host
