// What the library of a browser needs of the C++ library, so that it imports only functions of C.
#include <cstdlib>
#include <new>

void *operator new(std::size_t n) { return std::malloc(n ? n : 1); }
void *operator new(std::size_t n, const std::nothrow_t &) noexcept { return std::malloc(n ? n : 1); }
const std::nothrow_t std::nothrow{};
void operator delete(void *p) noexcept { std::free(p); }
void operator delete(void *p, std::size_t) noexcept { std::free(p); }
namespace std {
inline namespace __1 {
[[noreturn]] void __libcpp_verbose_abort(const char *, ...) noexcept { __builtin_trap(); }
}  // namespace __1
}  // namespace std
