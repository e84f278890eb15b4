#include "tools/tello/core/asking.hpp"

#include <algorithm>
#include <charconv>

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

Asking::Asking(const std::vector<std::string>& questions, Timeouts timeout) : timeout_(timeout) {
  questions_.push_back({"command", "", false});
  for (const std::string& text : questions) questions_.push_back({text, "", false});
}

void Asking::next() {
  ++current_;
  tries_ = 0;
}

std::string Asking::due(TimeNs now) {
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

void Asking::on_answer(std::string_view bytes) {
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

std::string Asking::answer(std::string_view question) const {
  const auto found =
      std::find_if(questions_.begin(), questions_.end(), [&](const Question& q) { return q.text == question; });
  return found == questions_.end() ? "" : found->answer;
}

}  // namespace ledgerline::tello
