#include "chaincode/network/processes/orderer_watch.hpp"

#include <fmt/format.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <sstream>

#include "chaincode/network/options.hpp"

namespace ledgerline::network {
namespace {

constexpr std::size_t max_bytes = 4 << 20;

/// The channel and the value of a line NAME{channel="X"} VALUE.
std::optional<std::pair<std::string, double>> value_of(const std::string& line, const std::string& name) {
  const std::string begin = name + "{channel=\"";
  const auto end = line.find("\"} ");
  if (!line.starts_with(begin) || end == std::string::npos) return std::nullopt;
  return std::pair{line.substr(begin.size(), end - begin.size()), std::strtod(line.c_str() + end + 3, nullptr)};
}

}  // namespace

std::map<std::string, RaftSign> raft_signs(const std::string& metrics) {
  std::map<std::string, RaftSign> signs;
  std::istringstream in(metrics);
  for (std::string line; std::getline(in, line);) {
    if (const auto leads = value_of(line, "consensus_etcdraft_is_leader")) {
      signs[leads->first].leads = leads->second > 0;
    } else if (const auto stored = value_of(line, "consensus_etcdraft_data_persist_duration_count")) {
      signs[stored->first].stored = stored->second > 0 ? static_cast<std::uint64_t>(stored->second) : 0;
    }
  }
  return signs;
}

Result<std::string> fetch_metrics(const std::string& address) {
  const auto listen = parse_listen_address(address);
  if (!listen) return listen.error();
  const sockaddr_in to = listen->address();
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  constexpr timeval timeout{0, 200'000};
  ::setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &timeout, sizeof timeout);
  ::setsockopt(fd, SOL_SOCKET, SO_SNDTIMEO, &timeout, sizeof timeout);
  constexpr std::string_view question = "GET /metrics HTTP/1.0\r\n\r\n";
  std::string answer;
  bool good = ::connect(fd, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0 &&
              ::send(fd, question.data(), question.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(question.size());
  char part[16384];
  for (ssize_t n = 1; good && n != 0 && answer.size() < max_bytes;) {
    n = ::recv(fd, part, sizeof part, 0);
    good = n >= 0;
    if (n > 0) answer.append(part, static_cast<std::size_t>(n));
  }
  const int why = errno;
  ::close(fd);
  if (!good) return Error{fmt::format("{} does not say its metrics: {}", address, std::strerror(why))};
  return answer;
}

StartCheck::Verdict StartCheck::update(TimeNs now, const std::map<std::string, RaftSign>& signs) {
  const bool all =
      std::all_of(channels_.begin(), channels_.end(), [&](const auto& one) { return signs.contains(one); });
  if (!all) return Verdict::not_known;
  if (!first_answer_) first_answer_ = now;
  bool takes_part = true;
  for (const std::string& channel : channels_) {
    const RaftSign& sign = signs.at(channel);
    const auto [first, is_new] = stored_first_.try_emplace(channel, sign.stored);
    takes_part = takes_part && (sign.leads || sign.stored >= first->second + 2);
  }
  if (takes_part) return Verdict::takes_part;
  return now - *first_answer_ >= limit_ ? Verdict::hangs : Verdict::not_known;
}

std::vector<std::string> OrdererWatch::update(TimeNs now, const std::vector<Processes::State>& states) {
  std::vector<std::string> hang;
  if (now < next_look_) return hang;
  next_look_ = now + between_ns;
  for (const Processes::State& state : states) {
    if (!state.name.starts_with("orderer") || state.pid == 0) continue;
    Watched& watched = watched_[state.name];
    if (watched.pid != state.pid) watched = {state.pid, StartCheck(channels_, limit_ns)};
    if (!watched.check) continue;
    const int number = std::stoi(state.name.substr(std::strlen("orderer")));
    const auto verdict = watched.check->update(now, signs_of_(number));  // one that ends is seen by itself
    if (verdict == StartCheck::Verdict::not_known) continue;
    watched.check.reset();
    if (verdict == StartCheck::Verdict::hangs) hang.push_back(state.name);
  }
  return hang;
}

}  // namespace ledgerline::network
