#include "tools/tello/core/dialogue.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <charconv>
#include <nlohmann/json.hpp>

#include "common/base/text.hpp"
#include "onboard/link/core/tello/serial_check.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::tello {

namespace {

constexpr std::size_t max_answer = 40;  // no expected answer has more than 18 characters

bool number_within(std::string_view text, int low, int high) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc{} && end == text.data() + text.size() && value >= low && value <= high;
}

// A word such as TELLO, RMTT or v01.04.91.01: no sentence, and no bare figure, which is another question's.
bool word(std::string_view text) {
  const bool printed = std::all_of(text.begin(), text.end(), [](char c) { return c > ' ' && c <= '~'; });
  const bool alphabetic = std::any_of(
      text.begin(), text.end(), [](char c) { return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '.'; });
  return !text.empty() && text.size() <= max_answer && printed && alphabetic &&
         link::parse_answer(text) == link::Answer::unknown;
}

// To `ap` some answer "OK,drone will reboot in 3s".
bool explained_ok(std::string_view text) {
  return text.size() > 3 && link::parse_answer(text.substr(0, 2)) == link::Answer::ok &&
         (text[2] == ',' || text[2] == ' ');
}

// A value is asked for; else it is a word that is obeyed. The password in one may end in anything.
bool asks(std::string_view question) { return question.ends_with('?') && question.find(' ') == std::string_view::npos; }

}  // namespace

bool fits(std::string_view question, std::string_view text) {
  if (question == "sn?") return link::is_serial(text) && word(text);
  if (question == "battery?") return number_within(text, 0, 100);
  if (question == "sdk?") return number_within(text, 10, 99);  // 1.3 does not know the question, then 20, 30
  if (asks(question)) return word(text);
  if (link::parse_answer(text) == link::Answer::ok) return true;
  return question != "command" && explained_ok(text);
}

Dialogue::Dialogue(const std::vector<std::string>& questions, Timeouts timeout) : timeout_(timeout) {
  questions_.push_back({"command", "", false});
  for (const std::string& text : questions) questions_.push_back({text, "", false});
}

void Dialogue::next() {
  ++current_;
  tries_ = 0;
}

std::string Dialogue::pop_due(TimeNs now) {
  if (over() || (tries_ > 0 && now - asked_ns_ < timeout_.answer_ns)) return "";
  if (tries_ >= timeout_.tries) {
    if (current_ == 0) {
      current_ = questions_.size();
      return "";
    }
    next();
    if (over()) return "";
  }
  ++tries_;
  asked_ns_ = now;
  return questions_[current_].text;
}

void Dialogue::on_answer(std::string_view bytes) {
  if (over() || tries_ == 0) return;
  Question& open = questions_[current_];
  const std::string_view text = link::without_line_end(bytes);
  const bool refused = link::parse_answer(text) == link::Answer::refused;
  const auto same = [&](const Question& other) {
    return &other != &open && !other.answer.empty() && other.answer == text;
  };
  // A question that was asked twice may be answered twice.
  const bool late = asks(open.text) && std::any_of(questions_.begin(), questions_.end(), same);
  if (!refused && (!fits(open.text, text) || late)) return;
  // A Tello refuses nothing before `command`, so one that does is there, but in no state to be asked.
  if (current_ == 0 && refused) return;
  present_ = true;
  open.refused = refused;
  open.answer = printable(text, max_answer);
  if (refused && asks(open.text)) open.answer.clear();
  next();
}

std::string Dialogue::answer(std::string_view question) const {
  const auto found =
      std::find_if(questions_.begin(), questions_.end(), [&](const Question& q) { return q.text == question; });
  return found == questions_.end() ? "" : found->answer;
}

namespace {

constexpr TimeNs repeat_ns = 1 * ns_per_s;        // as link: with half a drone may answer twice
constexpr TimeNs fresh_for_ns = 500 * ns_per_ms;  // state text comes at 10 Hz
constexpr TimeNs grounded_for_ns = 1 * ns_per_s;
constexpr float airborne_m = 0.25F, grounded_m = 0.15F;  // as link's SessionSettings
constexpr std::size_t max_refusal = 60;

}  // namespace

bool Landing::aloft(TimeNs now) const {
  return seen_ && now - state_ns_ < fresh_for_ns && (state_.height_m >= airborne_m || state_.tof_m > grounded_m);
}

std::vector<std::string> Landing::pop_due(TimeNs now) {
  // An ok counts when it comes, but not against the sight.
  if (oks_ > commands_ && started_ && !aloft(now)) down_ = true;
  if (down_ || (started_ && now - said_ns_ < repeat_ns)) return {};
  said_ns_ = now;
  started_ = true;
  std::vector<std::string> words;
  if (oks_ == 0) {
    words.emplace_back("command");
    ++commands_;
  }
  words.emplace_back("rc 0 0 0 0");
  words.emplace_back("land");
  return words;
}

void Landing::on_answer(std::string_view bytes) {
  switch (link::parse_answer(bytes)) {
    case link::Answer::ok:
      ++oks_;
      break;
    case link::Answer::refused:
      refusal_ = printable(link::without_line_end(bytes), max_refusal);
      break;
    case link::Answer::unknown:
      break;
  }
}

void Landing::on_state(TimeNs now, std::string_view bytes) {
  if (!link::parse_state(bytes, state_)) return;
  seen_ = true;
  state_ns_ = now;
  if (aloft(now)) {
    grounded_since_ns_ = 0;
  } else if (grounded_since_ns_ == 0) {
    grounded_since_ns_ = now;
  } else if (started_ && now - grounded_since_ns_ >= grounded_for_ns) {
    down_ = true;
  }
}

namespace {

constexpr int max_prefix = 32, min_prefix = 24;
// IEEE 802.11: a name has up to 32 bytes, a WPA2 password 8 to 63 characters.
constexpr std::size_t max_ssid = 32, min_password = 8, max_password = 63;

bool one_word(const std::string& text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return c > ' ' && c <= '~'; });
}

}  // namespace

Result<std::vector<std::uint32_t>> hosts_of(const std::string& cidr) {
  const std::size_t slash = cidr.find('/');
  const auto base = parse_ipv4(cidr.substr(0, slash));
  if (!base) return base.error();
  int prefix = 0;
  const char* const from = slash == std::string::npos ? nullptr : cidr.data() + slash + 1;
  const char* const to = cidr.data() + cidr.size();
  if (from == nullptr || std::from_chars(from, to, prefix).ptr != to || from == to || prefix < min_prefix ||
      prefix > max_prefix)
    return Error{fmt::format("'{}' is no subnet of /{} to /{}, such as 192.168.1.0/24", cidr, min_prefix, max_prefix)};
  const std::uint32_t size = std::uint32_t{1} << (max_prefix - prefix);
  const std::uint32_t first = *base & ~(size - 1);
  std::vector<std::uint32_t> hosts;
  for (std::uint32_t i = 0; i < size; ++i) {
    if (size > 2 && (i == 0 || i == size - 1)) continue;
    hosts.push_back(first + i);
  }
  return hosts;
}

Status check_wifi(const std::string& ssid, const std::string& password) {
  if (ssid.empty() || ssid.size() > max_ssid || !one_word(ssid))
    return Error{fmt::format(
        "the network's name must be 1 to {} characters without blanks, since the drone takes a blank for its "
        "end",
        max_ssid)};
  if (password.size() < min_password || password.size() > max_password || !one_word(password))
    return Error{fmt::format("the password must be {} to {} characters without blanks", min_password, max_password)};
  return done;
}

namespace {

std::string or_silent(const std::string& answer, const char* unit = "") {
  return answer.empty() ? "does not say" : answer + unit;
}

nlohmann::json or_null(const std::string& answer) { return answer.empty() ? nlohmann::json() : nlohmann::json(answer); }

}  // namespace

const std::vector<std::string>& questions_of_info() {
  static const std::vector<std::string> questions{"sn?", "battery?", "hardware?", "sdk?", "version?", "wifiversion?"};
  return questions;
}

std::string words(const std::vector<Found>& drones) {
  constexpr const char* row = "{:<15}  {:<16}  {:<12}  {:<12}  {:<12}  {}\n";
  std::string out = fmt::format(row, "ADDRESS", "SERIAL", "BATTERY", "SDK", "HARDWARE", "FIRMWARE");
  for (const Found& drone : drones) {
    const Dialogue& dialogue = drone.dialogue;
    const std::string version = dialogue.answer("version?");
    out += fmt::format(row, ipv4_text(drone.address), or_silent(dialogue.answer("sn?")),
                       or_silent(dialogue.answer("battery?"), " %"), or_silent(dialogue.answer("sdk?")),
                       or_silent(dialogue.answer("hardware?")),
                       or_silent(version.empty() ? dialogue.answer("wifiversion?") : version));
  }
  out.pop_back();
  return out;
}

std::string json(const std::vector<Found>& drones) {
  nlohmann::json list = nlohmann::json::array();
  for (const Found& drone : drones) {
    const Dialogue& dialogue = drone.dialogue;
    const std::string battery = dialogue.answer("battery?");
    list.push_back({{"address", ipv4_text(drone.address)},
                    {"serial", or_null(dialogue.answer("sn?"))},
                    {"battery", battery.empty() ? nlohmann::json() : nlohmann::json(std::stoi(battery))},
                    {"sdk", or_null(dialogue.answer("sdk?"))},
                    {"hardware", or_null(dialogue.answer("hardware?"))},
                    {"version", or_null(dialogue.answer("version?"))},
                    {"wifi_version", or_null(dialogue.answer("wifiversion?"))}});
  }
  return nlohmann::json{{"drones", list}}.dump();
}

}  // namespace ledgerline::tello
