#include "core/plot/picture_text.h"

#include <algorithm>
#include <array>
#include <cstdint>

#include "core/base/text.h"

namespace volalign {

namespace {

/// Latin-1's 32 to 126 and 160 to 255: the font 6x13 of the X Window System ("Public domain font.
/// Share and enjoy."). Seven characters per line, each of 13 rows from the top. A row is '0' plus
/// six bits, the highest of which is the leftmost pixel.
constexpr char kGlyphs[] = R"(
0000000000000008888888080000DDD00000000000DDnDnDD000008NXXL::l80000BZD48@DZT00000@XX@XVTJ00
00888000000000488@@@@@88400@884444488@0008ZLZ8000000000088n880000000000000<8@0000000n000000
0000000008L800022448@@PP00008DRRRRRD800008HX88888n0000LRR248@Pn0000n248L22RL000044<DDTn4400
00nPP\b22RL0000LRPPlRRRL0000n24488@@@0000LRRRLRRRL0000LRRRN22RL0000008L8008L8000008L800<8@0
00248@P@8420000000n00n000000P@84248@P0000LRR2488080000LRRVZZ\PN00008DRRRnRRR0000lBBBLBBBl00
00LRPPPPPRL0000lBBBBBBBl0000nPPPlPPPn0000nPPPlPPPP0000LRPPPVRRL0000RRRRnRRRR0000L8888888L00
00>444444TH0000RRTX`XTRR0000PPPPPPPPn0000RRfZZRRRR0000RbbZZVVRR0000LRRRRRRRL0000lRRRlPPPP00
00LRRRRRRZL2000lRRRlXTRR0000LRPPL22RL0000n888888880000RRRRRRRRL0000RRRRDDD880000RRRRZZZZD00
00RRDD8DDRR0000RRDD888880000n2448@@Pn000L@@@@@@@@@L000PP@@84422000L444444444L0008DR00000000
00000000000n0084000000000000000L2NRVJ0000PPPlRRRRl0000000LRPPRL0000222NRRRRN0000000LRnPRL00
00<B@@l@@@@0000000LRRRN2RL00PPP\bRRRR0000080H8888L0000040<4444TTH00PPPTX`XTR0000H8888888L00
00000dZZZZR0000000\bRRRR0000000LRRRRL0000000lRRRlPPP00000NRRRN22200000\bPPPP0000000LRH4RL00
000@@l@@@B<0000000RRRRVJ0000000RRRDD80000000RRZZZD0000000RD88DR0000000RRRVJ2RL00000n48@Pn00
068888`88886000888888888000`888868888`000BZT0000000000000000000000080888888800008LZXXZL8000
00<B@@h@@B\000000RLDDLR00000RRDDn8n880000888808888000<B@<BB<2B<000DD00000000000LRZfbfZRL000
00L2NRN0n00000000:DXXD:000000000n220000000000L0000000LRjffjfRL00000n000000000000<BB<0000000
00088n880n0000@X8@h00000000@X@8`0000000048000000000000000RRRRVjPP00NjjjjJ:::00000000<000000
00000000000480@`@@h000000000LRRRL0n00000000XD::DX0000@`@@h26:>2000@`@@h4:24>000@X@8XB6:>200
008088@PRRL000@808DRRnRR0004808DRRnRR000<B08DRRnRR000:D08DRRnRR000DD08DRRnRR0008D88DRRnRR00
00FXXX\hXX^0000LRPPPPPRL8@0@80nPPlPPn000480nPPlPPn000<B0nPPlPPn000DD0nPPlPPn000@80L88888L00
0480L88888L000<B0L88888L000DD0L88888L0000lBBBjBBBl000:D0RRbZVRR000@80LRRRRRL000480LRRRRRL00
0<B0LRRRRRL000:D0LRRRRRL000DD0LRRRRRL0000000RD8DR00002LVVZZZbbLP00@80RRRRRRL000480RRRRRRL00
0<B0RRRRRRL000DD0RRRRRRL000480RRD88880000PlRRRlPPP0000HTTXXTRR\0000@80L2NRVJ0000480L2NRVJ00
00<B0L2NRVJ0000:D0L2NRVJ0000DD0L2NRVJ000<B<0L2NRVJ0000000L:LXZD0000000LRPPRL8@00@80LRnPRL00
00480LRnPRL0000<B0LRnPRL0000DD0LRnPRL0000@80H8888L0000480H8888L0000<B0H8888L0000DD0H8888L00
0D8H4LRRRRL0000:D0\bRRRR0000@80LRRRRL0000480LRRRRL0000<B0LRRRRL0000:D0LRRRRL0000DD0LRRRRL00
000880n08800000002LVZZbLP000@80RRRRVJ0000480RRRRVJ0000<B0RRRRVJ0000DD0RRRRVJ0000480RRRVJ2RL
000PP\bRRb\PP00DD0RRRVJ2RL
)";
constexpr char kUnknown[] = "00nRRRRRRRn00";
static_assert(sizeof kUnknown == kTextHeight + 1);

/// The 13 rows of a character.
const char* GlyphOf(std::uint32_t character) {
  constexpr std::uint32_t kPerLine = 7;
  const bool latin = character >= 160 && character <= 255;
  if (!latin && (character < 32 || character > 126)) return kUnknown;
  const std::uint32_t index = latin ? character - 160 + 95 : character - 32;
  return kGlyphs + 1 + index * kTextHeight + index / kPerLine;
}

bool BeginsCharacter(char c) { return (static_cast<std::uint8_t>(c) & 0xc0) != 0x80; }

}  // namespace

int CountCharacters(const std::string& text) {
  return static_cast<int>(std::count_if(text.begin(), text.end(), BeginsCharacter));
}

void DrawText(RgbImage* picture, int left, int top, const std::string& text, Rgb colour) {
  for (std::size_t i = 0; i < text.size(); left += kTextWidth) {
    const Letter letter = LetterAt(text, i);
    const char* const glyph = letter.bytes > 0 ? GlyphOf(letter.code) : kUnknown;
    i += std::max<std::size_t>(letter.bytes, 1);
    for (int v = 0; v < kTextHeight; ++v) {
      for (int u = 0; u < kTextWidth; ++u) {
        const bool ink = (glyph[v] - '0') >> (kTextWidth - 1 - u) & 1;
        if (ink && picture->Contains(left + u, top + v)) (*picture)(left + u, top + v) = colour;
      }
    }
  }
}

std::string Ellipsized(const std::string& text, int most) {
  if (CountCharacters(text) <= most) return text;
  std::string shortened;
  int count = 0;
  for (const char c : text) {
    if (BeginsCharacter(c) && ++count > most - 2) break;
    shortened += c;
  }
  return shortened + "..";
}

RgbImage Captioned(const RgbImage& picture, const std::string& caption) {
  constexpr int kLine = kTextHeight + 2;
  RgbImage sheet(picture.width(), picture.height() + kLine, kPaper);
  DrawText(&sheet, 1, 0, Ellipsized(caption, picture.width() / kTextWidth), kInk);
  for (int v = 0; v < picture.height(); ++v) {
    for (int u = 0; u < picture.width(); ++u) sheet(u, kLine + v) = picture(u, v);
  }
  return sheet;
}

void DrawScale(RgbImage* picture, int left, int top, int width,
               const std::function<Rgb(double)>& colour,
               const std::array<std::string, 3>& numbers) {
  constexpr int kRamp = kScaleHeight - 2 - kTextHeight;
  for (int u = 0; u < width; ++u) {
    FillRectangle(picture, left + u, top, 1, kRamp, colour((u + 0.5) / width));
  }
  for (int i = 0; i < 3; ++i) {
    const std::string& number = numbers[static_cast<std::size_t>(i)];
    const int text = kTextWidth * CountCharacters(number);
    DrawText(picture, left + i * (width - text) / 2, top + kRamp + 2, number, kFaint);
  }
}

void FillRectangle(RgbImage* picture, int left, int top, int width, int height, Rgb colour) {
  const int right = std::min(left + width, picture->width());
  const int bottom = std::min(top + height, picture->height());
  for (int v = std::max(0, top); v < bottom; ++v) {
    for (int u = std::max(0, left); u < right; ++u) (*picture)(u, v) = colour;
  }
}

}  // namespace volalign
