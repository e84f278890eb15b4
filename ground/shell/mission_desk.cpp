#include "ground/shell/mission_desk.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/belief/identity.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"
#include "ground/mission/parse.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::ground {
namespace {

namespace fs = std::filesystem;
using service::ApiAnswer;
using service::MissionAsk;
using service::refusal;

constexpr TimeNs again_ns = 2 * ns_per_s;  // until the ledger is asked again
constexpr const char* accepted = R"({"accepted":true})";

ApiAnswer busy() { return refusal(503, "too many missions wait to be looked at: try again"); }
ApiAnswer done_or(const Status& status) {
  return status ? ApiAnswer{202, accepted} : refusal(409, status.error().what);
}

fabric::Call anchor_call(const std::string& digest, const std::string& what) {
  AnchorCall call;
  call.set_digest(digest);
  call.set_what(what);
  return {contract::anchor, {call.SerializeAsString()}};
}

std::string bytes_of(const crypto::Digest& digest) { return {digest.begin(), digest.end()}; }

}  // namespace

void MissionDesk::later(Task task) {
  tasks_.put(std::move(task));
  parts_.wake();
}

bool MissionDesk::work(Task task) {
  const std::lock_guard lock(worker_mutex_);
  return worker_ && worker_->post(std::move(task));
}

void MissionDesk::close() {
  std::unique_ptr<Workers> ending;
  {
    const std::lock_guard lock(worker_mutex_);
    ending = std::move(worker_);
  }
}

Status MissionDesk::restore() {
  const std::string& folder = parts_.settings.folder;
  if (folder.empty()) return done;
  std::error_code error;
  fs::create_directories(folder, error);
  std::vector<fs::path> files;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    const std::string name = at->path().filename().string();
    if (at->path().extension() == ".json" && name.find(".record") == std::string::npos) files.push_back(at->path());
  }
  if (error) return Error{fmt::format("[mission] folder {}: {}", folder, error.message())};
  std::sort(files.begin(), files.end());
  for (const fs::path& file : files) {
    const auto text = read_file(file.string());
    const auto id = text ? book_.restore(*text) : Result<std::string>(text.error());
    if (!id) {
      spdlog::error("{} is no mission that was kept here: {}", file.string(), id.error().what);
      continue;
    }
    spdlog::info("mission {} ({}) is known from before", book_.mission(*id).name, *id);
    read_signers(*id);
  }
  return done;
}

void MissionDesk::ask(MissionAsk asked, Answer answer) {
  if (asked.kind == MissionAsk::Kind::add) {
    if (!work([this, asked = std::move(asked), answer] { add(asked, answer); })) answer(busy());
    return;
  }
  later([this, asked = std::move(asked), answer = std::move(answer)] { answer_on_flight(asked, answer); });
}

// On the worker.
void MissionDesk::add(const MissionAsk& asked, const Answer& answer) {
  auto mission = asked.csv ? mission::mission_from_csv(asked.text, asked.name) : mission::mission_from_json(asked.text);
  if (!mission) return answer(refusal(400, mission.error().what));
  later([this, mission = std::move(*mission), answer] { take(mission, answer); });
}

void MissionDesk::take(mission::Mission mission, const Answer& answer) {
  const auto id = book_.add(std::move(mission));
  if (!id) return answer(refusal(409, id.error().what));
  keep(*id);
  read_signers(*id);
  check(*id, [this, id = *id, answer](std::vector<mission::Finding> findings) {
    book_.set_findings(id, std::move(findings));
    answer(book_.has(id) ? ApiAnswer{201, book_.show(id)} : refusal(409, "it was removed at once"));
  });
}

void MissionDesk::check(const std::string& id, std::function<void(std::vector<mission::Finding>)> then) {
  std::vector<mission::DroneNow> now;
  for (std::size_t i = 0; i < parts_.core.drones().size(); ++i) now.push_back(mission::drone_now(parts_.core, i));
  const bool taken = work([this, mission = book_.mission(id), now = std::move(now), then] {
    auto findings = mission::check(mission, book_.check_config(), now);
    later([then, findings = std::move(findings)]() mutable { then(std::move(findings)); });
  });
  if (taken) return;
  mission::Finding waits;
  waits.words = "it was not checked: too many missions wait to be looked at";
  then({std::move(waits)});
}

void MissionDesk::read_signers(const std::string& id) {
  const std::string digest = bytes_of(book_.digest(id));
  const bool taken = work([this, id, digest] {
    AnchorCall call;
    call.set_digest(digest);
    const auto answer = parts_.client.evaluate({contract::verify, {call.SerializeAsString()}});
    Anchors anchors;
    const Status read = answer ? parse_message(*answer, anchors) : Status(answer.error());
    std::vector<crypto::IdentityName> signers;
    for (const Anchor& anchor : anchors.anchors()) signers.push_back(belief::to_name(anchor.signer()));
    later([this, id, read, signers = std::move(signers)] {
      if (read) return book_.set_signers(id, signers);
      spdlog::warn("mission {}: who approved it cannot be read yet: {}", id, read.error().what);
      unread_[id] = monotonic_ns() + again_ns;
    });
  });
  if (!taken) unread_[id] = monotonic_ns() + again_ns;
}

void MissionDesk::ask_again(TimeNs now) {
  for (auto one = unread_.begin(); one != unread_.end();) {
    if (now < one->second) {
      ++one;
      continue;
    }
    const std::string id = one->first;
    one = unread_.erase(one);
    if (book_.has(id)) read_signers(id);
  }
}

void MissionDesk::look(const fabric::Block& block) {
  for (const fabric::Transaction& tx : block.transactions) {
    if (tx.code != 0 || tx.config || tx.event_name != contract::anchor) continue;
    AnchorCall anchored;
    if (!parse_message(tx.event_payload, anchored)) continue;  // an event of whoever; only what verify says counts
    for (const std::string& id : book_.ids()) {
      if (bytes_of(book_.digest(id)) == anchored.digest()) read_signers(id);
    }
  }
}

void MissionDesk::answer_on_flight(const MissionAsk& asked, const Answer& answer) {
  using Kind = MissionAsk::Kind;
  if (asked.kind == Kind::list) return answer({200, fmt::format(R"({{"missions":{}}})", book_.list())});
  if (!book_.has(asked.id)) return answer(refusal(404, "there is no such mission"));
  switch (asked.kind) {
    case Kind::show:
      return answer({200, book_.show(asked.id)});
    case Kind::approve:
      return approve(asked, answer);
    case Kind::start:
      return check(asked.id, [this, asked, answer](const std::vector<mission::Finding>& findings) {
        answer(done_or(book_.start(asked.id, asked.by, findings, parts_.core)));
      });
    case Kind::pause:
      return answer(done_or(book_.pause(asked.id)));
    case Kind::resume:
      return answer(done_or(book_.resume(asked.id)));
    case Kind::land:
      return answer(done_or(book_.land(asked.id, "somebody had all land")));
    case Kind::remove: {
      const Status removed = book_.remove(asked.id);
      if (removed) forget(asked.id);
      return answer(done_or(removed));
    }
    case Kind::list:
    case Kind::add:
      break;
  }
}

void MissionDesk::approve(const MissionAsk& asked, const Answer& answer) {
  const mission::Mission& mission = book_.mission(asked.id);
  if (asked.who) {
    service::OperatorCall call{.kind = service::OperatorCall::Kind::approve};
    call.digest = book_.digest(asked.id);
    call.mission = mission.name;
    const Status asked_now = parts_.sign(*asked.who, call);
    return answer(asked_now ? ApiAnswer{202, accepted} : refusal(503, asked_now.error().what));
  }
  const std::string what = fmt::format("mission {} may be flown", mission.name);
  parts_.client.submit(anchor_call(bytes_of(book_.digest(asked.id)), what),
                       [this, name = mission.name](const fabric::Outcome& outcome) {
                         if (outcome.kind == fabric::Outcome::Kind::committed) return;
                         later([this, name, words = outcome.message] {
                           parts_.tell(Level::warning, "", fmt::format("mission {} was not approved: {}", name, words));
                         });
                       });
  answer({202, accepted});
}

void MissionDesk::step(TimeNs now) {
  for (const Task& task : tasks_.take_all()) task();
  if (!unread_.empty()) ask_again(now);
  if (book_.busy()) {
    service::MissionBook::Outputs out = book_.step(now, parts_.core);
    for (const PilotWish& wish : out.wishes) parts_.wish(wish);
    for (const mission::RunEvent& event : out.events) parts_.tell(event.level, event.drone, event.text);
    for (const std::string& id : out.kept) keep(id);
    for (const std::string& id : out.ended) write_record(id);
  }
  if (book_.changed()) parts_.publish(book_.list());
}

void MissionDesk::keep(const std::string& id) {
  if (parts_.settings.folder.empty()) return;
  const bool taken = work([file = file_of(id), text = book_.keep(id)] {
    if (const Status kept = replace_file(file, text, 0600); !kept)
      spdlog::error("a mission is not kept: {}", kept.error().what);
  });
  if (!taken) spdlog::error("mission {} is not kept: too much waits for the disk", id);
}

void MissionDesk::forget(const std::string& id) {
  if (parts_.settings.folder.empty()) return;
  const bool taken = work([file = file_of(id)] {
    std::error_code error;
    fs::remove(file, error);
    if (error) spdlog::error("{} is not removed: {}", file, error.message());
  });
  if (!taken) spdlog::error("mission {} is not removed from the disk: too much waits for it", id);
}

// What happened is on the ledger: the record's hash, in ground's name.
void MissionDesk::write_record(const std::string& id) {
  const std::string text = book_.record(id, realtime_ns() / ns_per_s);
  const std::string what = fmt::format("what became of mission {}", book_.mission(id).name);
  parts_.client.submit(anchor_call(bytes_of(crypto::sha256(text)), what), [id](const fabric::Outcome& outcome) {
    if (outcome.kind != fabric::Outcome::Kind::committed)
      spdlog::error("what became of mission {} is not on the ledger: {}", id, outcome.message);
  });
  if (parts_.settings.folder.empty()) return;
  const std::string file = fmt::format("{}/{}.record.json", parts_.settings.folder, id);
  const bool taken = work([file, text] {
    if (const Status written = replace_file(file, text, 0644); !written) spdlog::error("{}", written.error().what);
  });
  if (!taken) spdlog::error("{} is not written: too much waits for the disk", file);
}

}  // namespace ledgerline::ground
