; esea_q31_round is floor((x + 2^(s - 1)) / 2^s), every x and s from 1 to 31.
; C esea_q31.c esea_q31_round
(set-logic QF_BV)
(assert (bvule #x00000001 s))
(assert (bvule s #x0000001f))
(define-fun wide () (_ BitVec 64) ((_ sign_extend 32) x))
(define-fun wide_s () (_ BitVec 64) ((_ zero_extend 32) s))
(define-fun exact () (_ BitVec 64)
  (bvashr (bvadd wide (bvshl #x0000000000000001 (bvsub wide_s #x0000000000000001))) wide_s))
(assert (not (= ((_ sign_extend 32) c_return) exact)))
(check-sat)
