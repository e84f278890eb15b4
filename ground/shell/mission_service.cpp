#include "ground/shell/mission_service.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"
#include "common/verification/control_records.hpp"
#include "ground/mission/mission.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::ground {
namespace {

namespace fs = std::filesystem;
using service::ApiAnswer;
using service::MissionRequest;
using service::refusal;

constexpr int max_tasks = 4;
constexpr const char* accepted = R"({"accepted":true})";

ApiAnswer busy() { return refusal(503, "too many missions wait to be looked at: try again"); }
ApiAnswer done_or(const Status& status) {
  return status ? ApiAnswer{202, accepted} : refusal(409, status.error().message);
}

/// For people; null: it changes nothing, or is reported when its operator has signed it.
const char* reported_words(const MissionRequest& asked) {
  using Kind = MissionRequest::Kind;
  switch (asked.kind) {
    case Kind::approve:
      return asked.who ? nullptr : "approve";
    case Kind::withdraw:
      return asked.who ? nullptr : "withdraw the approval of";
    case Kind::start:
      return "start";
    case Kind::pause:
      return "pause";
    case Kind::resume:
      return "resume";
    case Kind::land:
      return "land";
    case Kind::remove:
      return "remove";
    case Kind::list:
    case Kind::show:
    case Kind::add:
      break;
  }
  return nullptr;
}

std::string bytes_of(const crypto::Digest& digest) { return {digest.begin(), digest.end()}; }

/// Who of those that may approve has anchored this digest.
Result<std::vector<crypto::IdentityName>> signers_of(const verification::Evaluate& evaluate,
                                                     const verification::RolesByOrganisation& roles,
                                                     const crypto::Digest& digest) {
  Anchors anchors;
  for (const AnchorCall& call : service::approval_questions(bytes_of(digest), roles)) {
    const auto answer = evaluate({contract::verify, {call.SerializeAsString()}});
    if (!answer) return answer.error();
    Anchors some;
    if (const Status read = parse_message(*answer, some); !read) return read.error();
    anchors.MergeFrom(some);
  }
  return service::operators_in(anchors, roles);
}

/// Whose approval stands, of those who are operators or supervisors of one of the organisations now.
Result<std::vector<crypto::IdentityName>> approvers_of(const verification::Evaluate& evaluate,
                                                       std::span<const service::ApprovalTerms::Digests> newest_first,
                                                       const std::vector<std::string>& organisations) {
  const auto roles = verification::read_roles(evaluate, {organisations.begin(), organisations.end()});
  if (!roles) return roles.error();
  std::vector<service::PeriodSigners> periods;
  for (const auto& [approval, withdrawal] : newest_first) {
    auto approved = signers_of(evaluate, *roles, approval), withdrawn = signers_of(evaluate, *roles, withdrawal);
    if (!approved || !withdrawn) return (approved ? withdrawn : approved).error();
    periods.push_back({std::move(*approved), std::move(*withdrawn)});
  }
  auto approvers = service::standing_approvals(periods);
  if (!roles->left_out().empty() && approvers.empty())
    return Error{*roles->left_out().begin() + " has too many roles, or damaged ones"};
  return approvers;
}

}  // namespace

void MissionService::later(Task task) {
  tasks_.put(std::move(task));
  parts_.wake();
}

void MissionService::close() {
  closed_ = true;
  worker_.close(Workers::Waiting::dropped);
  disk_.close();
  tasks_.close();
  (void)tasks_.pop_all();
  waiting_.clear();
}

Status MissionService::restore() {
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
      spdlog::error("{} is no mission that was kept here: {}", file.string(), id.error().message);
      continue;
    }
    spdlog::info("mission {} ({}) is known from before", book_.mission(*id).name, *id);
    read_signers(*id);
  }
  return done;
}

void MissionService::request(MissionRequest asked, Answer answer) {
  if (asked.kind == MissionRequest::Kind::add) {
    if (!worker_.post([this, asked = std::move(asked), answer] { add(asked, answer); })) answer(busy());
    return;
  }
  later([this, asked = std::move(asked), answer = std::move(answer)] { answer_on_flight(asked, answer); });
}

// On the worker.
void MissionService::add(const MissionRequest& asked, const Answer& answer) {
  auto mission = asked.csv ? mission::mission_from_csv(asked.text, asked.name) : mission::mission_from_json(asked.text);
  if (!mission) return answer(refusal(400, mission.error().message));
  auto run = mission::MissionRun::make(std::move(*mission), parts_.settings.run);
  if (!run) return answer(refusal(400, run.error().message));
  const auto made = std::make_shared<mission::MissionRun>(std::move(*run));
  later([this, made, by = asked.by, answer] { add_run(std::move(*made), by, answer); });
}

void MissionService::add_run(mission::MissionRun run, const std::optional<crypto::IdentityName>& by,
                             const Answer& answer) {
  const auto id = book_.add(std::move(run), by);
  if (!id) return answer(refusal(409, id.error().message));
  save(*id);
  read_signers(*id);
  check(book_.mission(*id), [this, id = *id, answer](Checked checked) {
    book_.set_findings(id, std::move(checked.findings));
    answer(book_.has(id) ? ApiAnswer{201, book_.show(id)} : refusal(409, "it was removed at once"));
  });
}

void MissionService::check(const mission::Mission& mission, std::function<void(Checked)> then) {
  Checked checked;
  checked.then = mission::drones_now(parts_.flights);
  for (std::size_t i = 0; i < checked.then.size(); ++i) checked.then[i].way = mission::way_of(parts_.flights, i);
  const bool taken = worker_.post([this, mission, checked, then]() mutable {
    checked.findings = mission::check(mission, book_.check_config(), checked.then);
    later([then, checked = std::move(checked)]() mutable { then(std::move(checked)); });
  });
  if (taken) return;
  checked.findings = {service::not_checked()};
  then(std::move(checked));
}

void MissionService::read_signers(const std::string& id, std::function<void(const Status& read)> then) {
  std::vector<std::string> organisations = parts_.settings.approvers;
  if (organisations.empty()) organisations = {parts_.flights.config().self.msp_id};  // as the book counts them
  const auto digests = terms_.now(book_.digest(id), realtime_ns() / ns_per_s);
  const bool taken = worker_.post([this, id, digests, then, organisations = std::move(organisations)] {
    auto signers =
        approvers_of([this](const fabric::Call& call) { return query_ledger(call); }, digests, organisations);
    later([this, id, then, signers = std::move(signers)] {
      if (signers) {
        book_.set_signers(id, *signers);
      } else {
        spdlog::warn("mission {}: who approved it cannot be read yet: {}", id, signers.error().message);
        unread_.add(id, monotonic_ns());
      }
      if (then) then(signers ? Status(done) : Status(signers.error()));
    });
  });
  if (taken) return;
  unread_.add(id, monotonic_ns());
  if (then) then(Error{"too many missions wait to be looked at"});
}

Result<std::string> MissionService::query_ledger(const fabric::Call& call) {
  if (closed_) return Error{"the ground ends"};
  return parts_.client.evaluate(call);
}

void MissionService::on_block(const fabric::Block& block) {
  for (const std::string& id : service::anchored_in(block, book_, terms_, realtime_ns() / ns_per_s)) read_signers(id);
  if (service::changes_roles(block)) all_again_.request();
}

void MissionService::answer_on_flight(const MissionRequest& asked, const Answer& answer) {
  using Kind = MissionRequest::Kind;
  if (asked.kind == Kind::list) return answer({200, fmt::format(R"({{"missions":{}}})", book_.list())});
  if (!book_.has(asked.id)) return answer(refusal(404, "there is no such mission"));
  if (const char* words = reported_words(asked))
    parts_.report_request(
        fmt::format("{} mission {}, asked for by {}", words, book_.mission(asked.id).name, asked.asker));
  switch (asked.kind) {
    case Kind::show:
      return answer({200, book_.show(asked.id)});
    case Kind::approve:
    case Kind::withdraw:
      return anchor(asked, answer);
    case Kind::start:
      return fly(book_.mission(asked.id), &service::MissionBook::start, asked, answer);
    case Kind::pause:
      return answer(done_or(book_.pause(asked.id, asked.by)));
    case Kind::resume:
      return fly(book_.rest(asked.id), &service::MissionBook::resume, asked, answer);
    case Kind::land:
      return answer(done_or(book_.land(asked.id, "somebody had all land")));
    case Kind::remove: {
      const Status removed = book_.remove(asked.id, asked.by);
      if (removed) forget(asked.id);
      return answer(done_or(removed));
    }
    case Kind::list:
    case Kind::add:
      break;
  }
}

void MissionService::fly(const mission::Mission& part, Begin begin, const MissionRequest& asked, const Answer& answer) {
  // Two persons are two now, not when they clicked: what counts is what the ledger says at the start.
  read_signers(asked.id, [this, part, begin, asked, answer](const Status& read) {
    if (!read) return answer(refusal(503, "who approves it cannot be read now: " + read.error().message));
    check(part, [this, begin, asked, answer](const Checked& checked) {
      if (asked.who && !parts_.signed_in(*asked.who))  // he may have signed out while it was checked
        return answer(refusal(409, "the operator who requested it has signed out"));
      answer(done_or((book_.*begin)(asked.id, asked.by, checked, parts_.flights)));
    });
  });
}

// An approval, or what withdraws it.
void MissionService::anchor(const MissionRequest& asked, const Answer& answer) {
  using Kind = service::OperatorCall::Kind;
  const bool approves = asked.kind == MissionRequest::Kind::approve;
  const std::int64_t now_s = realtime_ns() / ns_per_s;
  service::OperatorCall call{.kind = approves ? Kind::approve : Kind::withdraw};
  const service::ApprovalTerms::Digests digests = terms_.now(book_.digest(asked.id), now_s).front();
  call.mission = book_.mission(asked.id).name;
  call.digest = approves ? digests.approval : digests.withdrawal;
  call.what = approves ? terms_.approval_words(call.mission, now_s) : terms_.withdrawal_words(call.mission);
  if (asked.who) {
    const Status asked_now = parts_.sign(*asked.who, call);
    return answer(asked_now ? ApiAnswer{202, accepted} : refusal(503, asked_now.error().message));
  }
  parts_.client.submit(service::contract_call(call, "", parts_.flights.config().self),
                       [this, words = service::words_of(call)](const fabric::Outcome& outcome) {
                         if (outcome.kind == fabric::Outcome::Kind::committed) return;
                         later([this, words, why = outcome.message] {
                           parts_.report(Level::warning, "", fmt::format("{}: refused: {}", words, why));
                         });
                       });
  answer({202, accepted});
}

void MissionService::step(TimeNs now) {
  for (Task& task : tasks_.pop_all()) waiting_.push_back(std::move(task));
  // A few a step: a client with many requests waits, and no command does.
  for (int i = 0; i < max_tasks && !waiting_.empty(); ++i) {
    const Task task = std::move(waiting_.front());
    waiting_.pop_front();
    task();
  }
  if (!waiting_.empty()) parts_.wake();
  for (const std::string& id : unread_.pop_due(now)) {
    if (book_.has(id)) read_signers(id);
  }
  const std::int64_t period = terms_.period(realtime_ns() / ns_per_s);
  if (std::exchange(period_, period) != period) all_again_.request();
  if (all_again_.start(now)) {
    for (const std::string& id : book_.ids()) read_signers(id);
  }
  if (book_.busy()) {
    service::MissionBook::Outputs out = book_.step(now, parts_.flights);
    for (const PilotCommand& command : out.commands) parts_.post_command(command);
    for (const mission::RunEvent& event : out.events) parts_.report(event.level, event.drone, event.text);
    for (const std::string& id : out.kept) save(id);
    for (const std::string& id : out.ended) write_record(id);
    for (const std::string& id : out.awaiting_check)
      check(book_.rest(id),
            [this, id](const Checked& checked) { book_.resume_after_check(id, checked, parts_.flights); });
  }
  if (book_.pop_changed()) parts_.publish(book_.list());
}

void MissionService::save(const std::string& id) {
  if (parts_.settings.folder.empty()) return;
  const bool taken = disk_.post([file = file_of(id), text = book_.saved(id)] {
    if (const Status kept = replace_file(file, text, 0600); !kept)
      spdlog::error("a mission is not kept: {}", kept.error().message);
  });
  if (!taken) spdlog::error("mission {} is not kept: too much waits for the disk", id);
}

void MissionService::forget(const std::string& id) {
  if (parts_.settings.folder.empty()) return;
  const bool taken = disk_.post([file = file_of(id)] {
    std::error_code error;
    fs::remove(file, error);
    if (error) spdlog::error("{} is not removed: {}", file, error.message());
  });
  if (!taken) spdlog::error("mission {} is not removed from the disk: too much waits for it", id);
}

// What happened is on the ledger: the record's hash, in ground's name.
void MissionService::write_record(const std::string& id) {
  const std::string text = book_.record(id, realtime_ns() / ns_per_s);
  const std::string what = fmt::format("what became of mission {}", book_.mission(id).name);
  parts_.client.submit(service::anchor_call(crypto::sha256(text), what), [id](const fabric::Outcome& outcome) {
    if (outcome.kind != fabric::Outcome::Kind::committed)
      spdlog::error("what became of mission {} is not on the ledger: {}", id, outcome.message);
  });
  if (parts_.settings.folder.empty()) return;
  const std::string file = fmt::format("{}/{}.record.json", parts_.settings.folder, id);
  const bool taken = disk_.post([file, text] {
    if (const Status written = replace_file(file, text, 0644); !written) spdlog::error("{}", written.error().message);
  });
  if (!taken) spdlog::error("{} is not written: too much waits for the disk", file);
}

}  // namespace ledgerline::ground
