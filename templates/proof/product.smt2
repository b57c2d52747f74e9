; esea_q63_mul_q31, s > 32: its products are those of b with the two words of a, and, as the distributive
; law puts these together, the two-step shift is the rounded quotient of the whole 128-bit product.
; C esea_q31.c esea_q63_mul_q31
(set-logic QF_BV)
(assert (bvule #x00000021 s))
(assert (bvule s #x0000005e))
(define-fun high () (_ BitVec 64) product_0)
(define-fun low () (_ BitVec 64) product_1)
(define-fun words () Bool (and
  (= left_0 (bvashr a #x0000000000000020)) (= right_0 ((_ sign_extend 32) b))
  (= left_1 (bvand a #x00000000ffffffff)) (= right_1 ((_ sign_extend 32) b))))
(assert (bvsle #xc000000000000000 high))
(assert (bvsle high #x4000000000000000))
(define-fun one () (_ BitVec 128) #x00000000000000000000000000000001)
(define-fun wide ((x (_ BitVec 64))) (_ BitVec 128) ((_ sign_extend 64) x))
(define-fun count () (_ BitVec 128) ((_ zero_extend 96) s))
(define-fun product () (_ BitVec 128)
  (bvadd (bvshl (wide high) #x00000000000000000000000000000020) (wide low)))
(define-fun exact () (_ BitVec 128)
  (bvashr (bvadd product (bvshl one (bvsub count one))) count))
(assert (not (and words (= (wide c_return) exact))))
(check-sat)
