#pragma once
#include <mutex>
#include <streambuf>
#include <string_view>

#include "common/rt/clock.hpp"

namespace ledgerline::ipc {

/// What stands before std::cerr's own buffer, since iceoryx writes there at each call that fails, three times a second
/// while RouDi is gone, for as long as that lasts. The first lines of each minute pass. Any thread.
class BoundedLines final : public std::streambuf {
 public:
  static constexpr int lines_a_minute = 10;  ///< half of it would cut off what one failed start writes

  explicit BoundedLines(std::streambuf& to, TimeNs (*now)() = monotonic_ns) : to_(to), now_(now) {}

 private:
  int_type overflow(int_type c) override {
    if (traits_type::eq_int_type(c, traits_type::eof())) return traits_type::not_eof(c);
    const char one = traits_type::to_char_type(c);
    return xsputn(&one, 1) == 1 ? c : traits_type::eof();
  }
  std::streamsize xsputn(const char* text, std::streamsize size) override {
    const std::lock_guard lock(mutex_);
    for (const char c : std::string_view(text, static_cast<std::size_t>(size))) put(c);
    return size;
  }
  int sync() override {
    const std::lock_guard lock(mutex_);
    return to_.pubsync();
  }

  void put(char c) {
    constexpr std::string_view note = "the further lines of this minute are left out\n";
    if (is_line_begin_ && now_() >= next_ns_) {
      next_ns_ = now_() + 60 * ns_per_s;
      lines_ = 0;
    }
    if (lines_ < lines_a_minute) to_.sputc(c);
    is_line_begin_ = c == '\n';
    if (is_line_begin_ && lines_ < lines_a_minute && ++lines_ == lines_a_minute)
      to_.sputn(note.data(), static_cast<std::streamsize>(note.size()));
  }

  std::streambuf& to_;
  TimeNs (*const now_)();
  std::mutex mutex_;
  TimeNs next_ns_ = 0;
  int lines_ = 0;
  bool is_line_begin_ = true;
};

}  // namespace ledgerline::ipc
